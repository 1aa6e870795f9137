"""Drives that a walk told: against what was drawn, and as the start of the next log."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from stadera import load_robot, weigh
from stadera.identify.schema import with_identified_legs
from stadera.lab.pinocchio import pinocchio_model
from stadera.lab.scenarios.catalog import SimulateSettings
from stadera.lab.scenarios.run import Run, simulate
from stadera.robot import JointDynamics, Robot
from stadera.robot.stance import standing_configuration
from stadera.trunk.drives import TERMS, _carried
from stadera.weigh import Weighing

ROBOT = load_robot("hyq")
JOINTS = [joint for leg in ROBOT.legs for joint in leg.joints]


@cache
def run(seed: int) -> Run:
    return simulate(ROBOT, "trot-load", SimulateSettings("real", duration=8.0, seed=seed, hold=2))


@cache
def weighed(seed: int) -> Weighing:
    return weigh(ROBOT, run(seed).recording)


def drawn(seed: int) -> np.ndarray:
    truth = run(seed).truth.drawn
    assert truth is not None
    found = np.array(
        [[truth["joints"][joint][term] for term in ("armature", "viscous", "coulomb")] for joint in JOINTS]
    )
    law, motion, names = truth["varying"]["friction"], run(seed).true_motion, list(truth["joints"])
    for joint, row in zip(JOINTS, found, strict=True):  # Coulomb friction varies with position: its mean on the path
        k, position = names.index(joint), motion.position[:, motion.joints.index(joint)]
        knots = np.linspace(law["low"][k], law["high"][k], len(law["variation"][k]))
        row[2] *= 1.0 + np.interp(position, knots, law["variation"][k]).mean()
    return found


def test_a_trot_tells_rotor_inertia_and_friction_within_their_bars() -> None:
    off, true, std = [], [], []
    for seed in (21, 22):
        drives = weighed(seed).drives
        assert drives is not None
        assert drives.joints == tuple(JOINTS)
        assert drives.observed[:, 2].all()
        off.append(drives.value[:, :3] - drawn(seed))
        moved = np.arange(12) % 3 > 0  # hips hardly turn while a robot trots straight on
        assert np.median(np.abs(off[-1][moved, 0] / drawn(seed)[moved, 0])) < 0.3  # rotor inertia
        true.append(drawn(seed))
        std.append(drives.std[:, :3])
    off, true, std = map(np.concatenate, (off, true, std))
    assert np.median(np.abs(off[:, 2] / true[:, 2])) < 0.25  # Coulomb friction
    z = np.abs(off / std)
    assert np.median(z) < 1.2
    assert np.quantile(z, 0.9) < 2.5


def test_a_rotor_is_known_no_better_than_the_links_beyond_it() -> None:
    """The inertia about each joint, against Pinocchio's joint-space inertia without rotors."""
    model = pinocchio_model(ROBOT.with_dynamics(dict.fromkeys(ROBOT.tree.joints, JointDynamics())))
    q = np.concatenate([pin.neutral(model)[:7], standing_configuration(ROBOT)])
    whole = np.diag(pin.crba(model, model.createData(), q))[6:]
    np.testing.assert_allclose(_carried(ROBOT)[0][0].sum(axis=1), whole, rtol=1e-9)


def test_an_offset_is_known_no_better_than_the_weight_of_the_links_beyond_it() -> None:
    """The torque of the weight, against Pinocchio's, and what a displacement does to it at most, by differences."""

    def weights(robot: Robot) -> np.ndarray:
        model = pinocchio_model(robot)
        q = np.concatenate([pin.neutral(model)[:7], standing_configuration(ROBOT)])
        return pin.computeGeneralizedGravity(model, model.createData(), q)[6:]

    (_, torque), moved = _carried(ROBOT)
    np.testing.assert_allclose(torque.sum(axis=1), weights(ROBOT), atol=1e-9)
    link = ROBOT.legs[0].links[1]
    k, slopes = ROBOT.tree.links.index(link) - 1, []
    for axis in np.eye(3):
        body = ROBOT.inertias[link]
        other = ROBOT.with_inertias({link: body.shifted(0.01 * axis)})
        slopes.append((weights(other) - weights(ROBOT)) / 0.01)
    np.testing.assert_allclose(moved[:, k], np.linalg.norm(slopes, axis=0), atol=1e-9)


def test_what_was_not_observed_is_the_models() -> None:
    drives = weighed(21).drives
    assert drives is not None
    for j, joint in enumerate(drives.joints):
        for k, term in enumerate(TERMS):
            said = drives.to_dict()[joint][term]
            assert (said["std"] is None) == (not drives.observed[j, k])
            assert said["std"] is not None or said["value"] == said["prior"] == drives.model[j, k]


def test_the_next_log_starts_from_them(tmp_path: Path) -> None:
    weighed(21).save_json(tmp_path / "walk.json")
    robot = with_identified_legs(ROBOT, tmp_path / "walk.json")
    drives = weighed(21).drives
    assert drives is not None
    for j, joint in enumerate(drives.joints):
        assert robot.dynamics[joint].coulomb == pytest.approx(max(drives.value[j, 2], 0.0))
        assert robot.dynamics_std[joint].coulomb == pytest.approx(drives.std[j, 2])
    again = weigh(robot, run(21).recording)
    assert again.mass == pytest.approx(weighed(21).mass, abs=weighed(21).mass_std)
    assert again.trust.verdict == "good"
