"""The payload by difference: what is constant cancels, and the rest is as large as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stadera.lab.laws.static import stated_errors
from stadera.robot import load_robot
from stadera.robot.stance import standing_configuration
from stadera.trunk import ContactForceEstimator, Measurement
from stadera.trunk.standing.poses import Alike, PoseMean, payload_between
from standing import StandingRobot

ROBOT = load_robot("hyq")
STANCE = standing_configuration(ROBOT)
LOAD, PLACE = 8.0, (-0.2, 0.1, 0.1)
FORCES = ContactForceEstimator(ROBOT)
ERRORS = stated_errors(FORCES.robot, FORCES.noise)
BARE = StandingRobot(ROBOT).measurement(0.0, STANCE)
LOADED = StandingRobot(ROBOT, LOAD, PLACE).measurement(0.0, STANCE)
LIMIT = np.array([ROBOT.limits[joint].effort for joint in ROBOT.tree.joints])


def mean_of(exact: Measurement, offset: np.ndarray, white: float, rng: np.random.Generator) -> PoseMean:
    efforts = exact.effort + offset + white * LIMIT * rng.standard_normal((200, len(LIMIT)))
    pose = PoseMean(replace(exact, effort=efforts[0]))
    for effort in efforts[1:]:
        assert pose.takes(replace(exact, effort=effort), Alike())
    return pose


def weighed(white: float, seed: int) -> tuple[float, float, np.ndarray, float]:
    """Errors of mass [kg] and of the centre of mass's x-y over their standard deviations, and that of the mass."""
    rng = np.random.default_rng(seed)
    offset = 0.0033 * LIMIT * rng.standard_normal(len(LIMIT))
    tare, loaded = (mean_of(exact, offset, white, rng) for exact in (BARE, LOADED))
    found = payload_between([tare], [loaded], FORCES, ERRORS)
    off = (found.com - PLACE)[:2] / found.com_std[:2]
    return found.mass - LOAD, (found.mass - LOAD) / found.mass_std, off, found.mass_std


def test_offsets_cancel_in_the_payload_but_not_in_the_trunk() -> None:
    error, _, _, _ = weighed(0.0, 0)
    assert abs(error) < 1e-3  # in one pose, exactly but for the weak prior
    felt = ERRORS.covariance[:12, :12]
    assert np.sqrt(felt.trace()) > 1.0  # N·m, that were there


def test_errors_are_as_large_as_stated_with_the_noise_stated_and_with_twice_that() -> None:
    for white in (0.0033, 0.0066):
        squares, widths = [], []
        for seed in range(8):
            _, mass, com, std = weighed(white, seed)
            squares.append([mass**2, *com**2])
            widths.append(std)
        # χ² of 8 draws, its central 99.8 %, for each
        total = np.sum(squares, axis=0)
        assert 0.86 < total[0] < 26.1
        assert (total[1:] < 26.1).all()
        assert np.mean(widths) < 0.2  # kg; the trunk's own is half a kilogram
