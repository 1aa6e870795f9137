"""What the viewer draws, against the truth of a motion that Pinocchio worked out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stadera.lab.plant.sensors import IDEAL
from stadera.live.view import Posture, Postures, Viewer
from stadera.robot import Robot
from stadera.robot.imu import ImuMount
from stadera.trunk.estimator import TrunkEstimator
from stadera.trunk.samples import Samples
from walking import Motion, Walk, recorded, walked


@pytest.fixture(scope="module")
def motion(robot: Robot) -> Motion:
    return walked(robot, Walk(seconds=1.5, rate_hz=250.0, speed=0.1, sway=0.002))


@pytest.fixture(scope="module")
def samples(robot: Robot, motion: Motion) -> Samples:
    return Samples.of_recording(recorded(robot, motion, IDEAL), robot)


def test_tilt_forces_and_feet_are_those_of_the_motion(robot: Robot, motion: Motion, samples: Samples) -> None:
    found: list[Posture] = []
    postures = Postures(robot)
    for start in range(0, len(samples), 7):
        found += postures.of(samples[start : start + 7], ImuMount.of(robot))
    assert np.diff([p.time for p in found]) == pytest.approx(0.04, abs=0.005)
    for posture in found[12:]:
        k = int(np.argmin(np.abs(motion.time - posture.time)))
        up, truth = posture.rotations[0].T[:, 2], motion.rotation[k].T[:, 2]  # the vertical in trunk axes
        assert np.arccos(up @ truth) < 0.05
        truth = (motion.rotation[k] @ motion.force[k].T).sum(axis=1)
        assert posture.forces.sum(axis=0)[2] == pytest.approx(truth[2], rel=0.1)
        feet = (posture.contacts - posture.origins[0]) @ posture.rotations[0]
        np.testing.assert_allclose(feet, motion.contact[k], atol=0.005)  # each below its centre along its own normal
        assert posture.contacts[:, 2].min() == pytest.approx(0.0, abs=1e-12)


def test_a_viewer_writes_what_it_would_show(robot: Robot, samples: Samples, tmp_path: Path) -> None:
    estimator = TrunkEstimator(robot)
    with Viewer(robot, save=tmp_path / "out.rrd") as viewer:
        for k in range(0, len(samples), 50):
            estimator.add(samples[k : k + 50])
            viewer.watch(samples[k : k + 50], estimator)
            if k == 200:
                estimator.tare()
    assert (tmp_path / "out.rrd").stat().st_size > 20_000
