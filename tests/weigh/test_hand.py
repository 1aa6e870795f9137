"""A load in a humanoid's hand that comes some time after the tare, lost in the bars of what its legs tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from stadera.checks import diagnose
from stadera.inertia import InertialParameters
from stadera.lab.scenarios.catalog import Load, SimulateSettings
from stadera.lab.scenarios.run import Run, simulate
from stadera.logs.mend import changed
from stadera.logs.recording import Recording, take
from stadera.robot import load_robot
from stadera.robot.model import Robot
from stadera.weigh import weigh
from stadera.weigh.reading import with_extra_joints

LOADED = 3.0  # s
LEFT, RIGHT = "left_wrist_yaw_link", "right_wrist_yaw_link"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("g1")


@pytest.fixture(scope="module")
def made(robot: Robot) -> Run:
    load = Load(2.0, "kg", (0.0, 0.0, 0.0), on="left_rubber_hand")
    return simulate(
        robot, "shake", SimulateSettings("real", load, duration=6.5, rate=200.0, seed=3, load_time=LOADED, arms=0.3)
    )


def test_what_only_the_arm_feels_is_a_change(robot: Robot, made: Run) -> None:
    """The arm's joints rub with 3 to 8 % of their limits. Taken for a load since the tare, it would be a tenth lighter
    and its centre a decimetre higher, by ten standard deviations.
    """
    found = weigh(robot, made.recording, (0.0, LOADED - 0.5))
    payload, true = found.payload, made.truth.moments[-1]
    assert payload is not None
    assert payload.at == LEFT
    assert repr(payload).endswith(f"at and in the frame of {LEFT}")
    assert abs(payload.mass - true.payload_mass) < 3.0 * payload.mass_std
    np.testing.assert_array_less(np.abs(payload.com - [0.0415, 0.003, 0.0]), 3.0 * payload.com_std)
    assert [change.at for change in found.changes][-1] == payload.at
    assert abs(found.changes[-1].time - LOADED) < 0.7


def test_hands_of_another_mass_than_the_model_s_are_no_load(robot: Robot, made: Run) -> None:
    """By 0.7 kg each, as much as a hand with three fingers has. What the arms' torques say of that before the load came
    counts: without it the load would be at the pelvis, by a million to one.
    """
    extra = robot.extra
    assert extra is not None
    bodies = list(extra.bodies)
    for link in (LEFT, RIGHT):
        at = extra.links.index(link)
        bodies[at] += InertialParameters.from_com(0.7, bodies[at].com, np.zeros((3, 3)))
    heavier = replace(extra, bodies=tuple(bodies))
    trunk = robot.inertias[robot.trunk] + (heavier.lumped - extra.lumped)
    other = replace(robot, extra=heavier, inertias={**robot.inertias, robot.trunk: trunk})
    payload = weigh(other, made.recording, (0.0, LOADED - 0.5)).payload
    assert payload is not None
    assert payload.at == LEFT
    assert abs(payload.mass - made.truth.moments[-1].payload_mass) < 3.0 * payload.mass_std


def test_a_place_that_the_log_contradicts_is_doubted(robot: Robot, made: Run) -> None:
    found = weigh(robot, made.recording, (0.0, LOADED - 0.5), at=RIGHT)
    assert found.payload is not None
    assert found.payload.at == RIGHT
    assert found.trust.verdict == "doubtful"
    assert any(f"said to be at {RIGHT}, but it is at {LEFT}" in reason for reason in found.trust.reasons)


def test_a_wrong_place_is_doubted_though_the_load_seems_to_change(robot: Robot) -> None:
    """Weighed at the other hand, the load seems to shift as the arm swings; the rows since then say nothing."""
    load = Load(2.0, "kg", (0.05, 0.0, 0.02), on=LEFT)
    settings = SimulateSettings("standard", load, duration=6.7, rate=250.0, seed=2, load_time=LOADED, arms=0.3)
    recording = simulate(robot, "shake", settings).recording
    found = weigh(robot, recording, (0.0, LOADED - 0.2), at=RIGHT)
    assert [change.kind for change in found.changes] == ["on", "shifted", "shifted"]
    assert any(f"said to be at {RIGHT}, but it is at {LEFT}" in reason for reason in found.trust.reasons)
    assert weigh(robot, recording, (0.0, LOADED - 0.2), at=LEFT).trust.verdict == "good"


# -- what is wrong with the arms --------------------------------------------------------------------------------------
def reordered(recording: Recording, order: Sequence[int], *channels: str) -> Recording:
    """Joints outside the legs, which are called as if they came in the robot's order."""
    others = recording.others
    assert others is not None
    return replace(recording, others=replace(others, **{c: getattr(others, c)[:, order] for c in channels}))


def exchanged(recording: Recording, *channels: str) -> Recording:
    """Left and right arm, in these channels."""
    return reordered(recording, [*range(3), *range(10, 17), *range(3, 10)], *channels)


def scaled(recording: Recording, part: str, factor: float, *channels: str) -> Recording:
    """Joints with a word in their names."""
    others = recording.others
    assert others is not None
    factors = np.array([factor if part in name else 1.0 for name in others.names])
    return replace(recording, others=replace(others, **{c: getattr(others, c) * factors for c in channels}))


FAULTS: dict[str, Callable[[Recording], Recording]] = {
    f"the arms of {LEFT} and {RIGHT} are swapped": lambda log: exchanged(log, "position", "velocity", "effort"),
    f"the torques of the arms of {LEFT} and {RIGHT} are swapped": lambda log: exchanged(log, "effort"),
    "joints by kind and by arm are swapped": lambda log: reordered(
        log, [*range(3), *np.arange(3, 17).reshape(2, 7).T.ravel()], "position", "velocity", "effort"
    ),
    "the torques of joints of the arms and others outside the legs are swapped": lambda log: reordered(
        log, [*range(3, 17), *range(3)], "effort"
    ),
    "the sign of the torque of 'left_elbow_joint' is reversed": lambda log: scaled(log, "left_elbow", -1.0, "effort"),
    "the signs of all values of 'waist_pitch_joint' are reversed": lambda log: scaled(
        log, "waist_pitch", -1.0, "position", "velocity", "effort"
    ),
    "the positions of the joints outside the legs are in degrees": lambda log: scaled(
        log, "", 180.0 / np.pi, "position", "velocity"
    ),
}


@pytest.fixture(scope="module")
def read(robot: Robot, made: Run) -> tuple[Robot, Recording]:
    """The log with its arms, and the robot as it begins."""
    posed, (log,), _ = with_extra_joints(robot, made.recording)
    assert isinstance(log, Recording)
    return posed, log.of_joints(robot.tree.joints)


def test_sound_arms_are_not_accused(read: tuple[Robot, Recording]) -> None:
    robot, log = read
    assert diagnose(log, robot) == ()


@pytest.mark.parametrize("fault", FAULTS)
def test_arms_that_are_misread_are_named_and_mended(fault: str, read: tuple[Robot, Recording]) -> None:
    robot, log = read
    (finding,) = diagnose(FAULTS[fault](log), robot)
    assert str(finding).startswith(fault)
    assert finding.fatal
    assert finding.mend is not None
    mended = changed(FAULTS[fault](log), [finding.mend])
    assert mended.others is not None
    assert log.others is not None
    for channel in ("position", "velocity", "effort"):
        np.testing.assert_allclose(getattr(mended.others, channel), getattr(log.others, channel))


def test_a_torque_that_stands_still_is_named_unless_it_is_zero(read: tuple[Robot, Recording]) -> None:
    robot, log = read
    assert log.others is not None
    assert log.others.effort is not None
    for last, causes in ((1.5, ["stuck"]), (0.0, [])):
        effort = log.others.effort.copy()
        effort[len(effort) // 3 :, log.others.names.index("left_elbow_joint")] = last
        found = diagnose(replace(log, others=replace(log.others, effort=effort)), robot)
        assert [each.cause for each in found] == causes


def test_arms_are_checked_beside_what_stands_still(read: tuple[Robot, Recording]) -> None:
    robot, log = read
    wrong = exchanged(log, "effort")
    assert wrong.effort is not None
    effort = wrong.effort.copy()
    effort[400:440, 3] = effort[400, 3]  # 0.2 s of a knee
    assert [each.cause for each in diagnose(replace(wrong, effort=effort), robot)] == ["stuck", "joint_order"]


@pytest.mark.parametrize("samples", [2, 5, 30])
def test_few_samples_say_nothing_of_the_arms(samples: int, read: tuple[Robot, Recording]) -> None:
    robot, log = read
    assert not any(each.cause in ("limb_torques", "joint_order") for each in diagnose(take(log, slice(samples)), robot))


def test_a_mended_log_is_weighed_as_a_sound_one(robot: Robot, made: Run) -> None:
    """Also the pose of the arms, at which the trunk contains them, is that of the mended log."""
    degrees = list(made.recording.joints[12:])
    factors = np.where(np.isin(made.recording.joints, degrees), 180.0 / np.pi, 1.0)
    wrong = replace(made.recording, position=made.recording.position * factors, velocity=None)
    sound = replace(made.recording, velocity=None)
    found, right = (weigh(robot, log, (0.0, LOADED - 0.5), fix=True) for log in (wrong, sound))
    np.testing.assert_allclose(found.com, right.com, atol=1e-9)
    assert found.payload is not None
    assert found.payload.at == LEFT


def test_torques_that_nothing_explains_are_doubted(read: tuple[Robot, Recording]) -> None:
    robot, log = read
    others = log.others
    assert others is not None
    wrong = replace(log, others=replace(others, effort=np.roll(others.effort, 1, axis=1)))
    (finding,) = diagnose(wrong, robot)
    assert finding.cause == "limb_torques"
