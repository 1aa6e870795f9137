"""Messages give what the same messages give as a file; and whatever happens to them, the estimate goes on."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from on_zenoh import LOADED_AT, arrivals

import bags
from bags import Sent
from logs_to_play import LOAD
from stadera import IdentificationError
from stadera.joint_words import matched
from stadera.live import LiveSession, LiveState
from stadera.live.keys import Sent as Attached
from stadera.live.topics import Arrival
from stadera.logs import Recording, Topics
from stadera.logs.bags.unitree import MOTORS
from stadera.report.live import live_lines
from stadera.robot import Robot, load_robot
from stadera.robot.imu import ImuMount
from stadera.trunk.memory import Memory
from stadera.weigh.weigh import weigh

TARE = 2.0  # s


@pytest.fixture(scope="module")
def ros(walk: Recording) -> list[Sent]:
    """JointState and Imu of the walk."""
    return list(bags.of_recording(walk))


@pytest.fixture(scope="module")
def lowstate(walk: Recording) -> list[Sent]:
    """LowState of the walk, late by up to 3 ms."""
    unit, rng = walk.imu, np.random.default_rng(0)
    assert unit is not None
    motors = [walk.joints.index(name) for name in (matched(MOTORS, walk.joints) or {}).values()]
    late = np.maximum.accumulate(walk.time + rng.uniform(0.0, 0.003, len(walk)))
    return [
        bags.low_state(
            late[k],
            *(getattr(walk, name)[k][motors] for name in ("position", "velocity", "effort")),
            tick=round(1e3 * float(walk.time[k])) + 5000,
            imu=(unit.angular_velocity[k], unit.linear_acceleration[k]),
        )
        for k in range(len(walk))
    ]


def fed(session: LiveSession, messages: Iterable[Arrival], most: int = 100) -> LiveState:
    """The state after messages that are taken in a few at a time, fewer than `most`."""
    waiting, rng = list(messages), np.random.default_rng(0)
    while waiting:
        count = int(rng.integers(1, most))
        session.feed(waiting[:count])
        last, waiting = waiting[min(count, len(waiting)) - 1].arrived, waiting[count:]
    return session.state(last)


@pytest.mark.parametrize("kind", ["ros", "lowstate"])
def test_the_same_messages_give_the_same_as_from_a_file(
    kind: str, robot: Robot, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    sent: list[Sent] = request.getfixturevalue(kind)
    session, messages = LiveSession(robot), arrivals(sent, delay=1000.0)
    cut = next(k for k, message in enumerate(messages) if message.arrived > 1000.0 + TARE)
    tared = fed(session, messages[:cut], most=20)
    assert session.tare().success
    live = fed(session, messages[cut:], most=20)
    file = weigh(robot, bags.write_mcap(sent, tmp_path / "log.mcap"), (0.0, tared.time))
    assert live.payload is not None
    assert file.payload is not None
    assert live.time == pytest.approx(file.time, abs=0.021)
    np.testing.assert_allclose(live.trunk.inertial.vector, file.trunk.inertial.vector, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(live.trunk.covariance, file.trunk.covariance, rtol=1e-7)
    assert live.payload.mass == pytest.approx(file.payload.mass, rel=1e-9)
    np.testing.assert_allclose(live.payload.com, file.payload.com, rtol=1e-8)
    assert [c.noticed for c in live.changes] == [c.noticed for c in file.changes]
    assert live.changes[0].time == pytest.approx(LOADED_AT, abs=0.1)
    assert abs(live.payload.mass - LOAD.mass) < 4.0 * live.payload.mass_std
    assert not live.waiting_for
    assert not any(live.lost.values())


# -- bad days ---------------------------------------------------------------------------------------------------------
def later(messages: Iterable[Arrival], seconds: float) -> list[Arrival]:
    """The same messages, arriving later; their stamps stay."""
    return [m._replace(arrived=m.arrived + seconds) for m in messages]


def goes_on(session: LiveSession, messages: list[Arrival], until: float, most: int = 100) -> LiveState:
    """After all of it the estimate is as far as time has gone on, and holds."""
    state = fed(session, messages, most)
    assert state.time == pytest.approx(until, abs=0.05)
    assert not state.waiting_for
    assert state.trunk.observed[0]
    truth = session.robot.inertias[session.robot.trunk].mass
    assert abs(state.trunk.inertial.mass - truth) < 4.0 * state.trunk.mass_std
    return state


@pytest.fixture(scope="module")
def unloaded(ros: list[Sent]) -> list[Arrival]:
    return arrivals([m for m in ros if m.received < 2_000_000_000])


@pytest.fixture(scope="module")
def plain(robot: Robot, unloaded: list[Arrival]) -> LiveState:
    """The state after them as they are."""
    return fed(LiveSession(robot), unloaded)


def test_what_was_learnt_of_a_robot_is_remembered(robot: Robot, unloaded: list[Arrival]) -> None:
    session = LiveSession(robot, memory=Memory.none(robot))
    assert session.remembered()[0] is None
    fed(session, unloaded)
    first, said = session.remembered()
    assert first is not None, said
    assert first.logs == 1
    assert first.days > 2e4  # days since 1970
    again = LiveSession(robot, memory=first)
    fed(again, unloaded)
    second, said = again.remembered()
    assert second is None
    assert "already" in said
    assert session.estimator is not None
    assert again.estimator is not None
    once = session.estimator.trunk.mass_std
    assert again.estimator.trunk.mass_std == pytest.approx(once, rel=1e-3)  # a log does not count twice
    with pytest.raises(IdentificationError, match="another model"):
        LiveSession(load_robot("go2"), memory=Memory.none(load_robot("hyq")))


def test_nothing_yet_names_what_is_seen(robot: Robot) -> None:
    session = LiveSession(robot)
    session.feed(arrivals([bags.text(0.0)]))
    (lacking,) = session.state(0.1).waiting_for
    assert "JointState" in lacking
    assert "/chatter (std_msgs/msg/String)" in lacking


def test_messages_that_are_none(robot: Robot, unloaded: list[Arrival]) -> None:
    rubbish = [m._replace(data=b"\0\1\0\0rubbish") if m.topic == "/joint_states" else m for m in unloaded]
    state = fed(LiveSession(robot), rubbish)
    assert state.waiting_for == ("messages of /joint_states that are a sensor_msgs/msg/JointState",)
    assert state.lost["damaged"] == 500


def test_an_imu_alone(robot: Robot, unloaded: list[Arrival]) -> None:
    session = LiveSession(robot)
    state = fed(session, [m for m in unloaded if m.topic == "/imu/data"])
    assert "joint states" in state.waiting_for[0]
    assert "/imu/data" in state.waiting_for[0]


def test_an_imu_that_comes_late(robot: Robot, unloaded: list[Arrival]) -> None:
    late = [m for m in unloaded if m.topic == "/joint_states" or m.arrived > 0.8]
    session = LiveSession(robot)
    assert "an IMU" in fed(session, [m for m in late if m.arrived < 0.8]).waiting_for[0]
    goes_on(session, [m for m in late if m.arrived >= 0.8], 2.0)


def test_half_the_joints_are_named(robot: Robot, walk: Recording, unloaded: list[Arrival]) -> None:
    names = walk.joints[:6]
    half = [
        bags.joints(float(t), names, walk.position[k][:6], walk.velocity[k][:6], walk.effort[k][:6])
        for k, t in enumerate(walk.time[:300])
    ]
    session = LiveSession(robot)
    state = fed(session, sorted(chain(arrivals(half), unloaded[1:600:2]), key=lambda m: m.arrived))
    assert walk.joints[6] in state.waiting_for[0]
    goes_on(session, [m for m in unloaded if m.arrived > 1.2], 2.0)


def test_two_publishers_with_half_the_joints_each_in_another_order(robot: Robot, walk: Recording) -> None:
    rows, unit = range(500), walk.imu
    assert unit is not None
    sent = [
        bags.imu(float(walk.time[k]), unit.angular_velocity[k], unit.linear_acceleration[k], frame="") for k in rows
    ]
    for part in (range(6), range(11, 5, -1)):
        names = [walk.joints[j] for j in part]
        values = [
            np.ascontiguousarray(getattr(walk, name)[:, list(part)]) for name in ("position", "velocity", "effort")
        ]
        sent += [bags.joints(float(walk.time[k]), names, *(v[k] for v in values)) for k in rows]
    goes_on(LiveSession(robot), arrivals(sorted(sent, key=lambda m: m.received)), 2.0)


def test_joints_change_their_order(robot: Robot, walk: Recording, unloaded: list[Arrival], plain: LiveState) -> None:
    order = np.random.default_rng(1).permutation(12)
    names = [walk.joints[j] for j in order]
    turned = [
        bags.joints(float(t), names, walk.position[k][order], walk.velocity[k][order], walk.effort[k][order])
        for k, t in enumerate(walk.time[:500])
    ]
    first = [m for m in unloaded if m.topic == "/imu/data" or m.arrived < 1.0]
    second = [m for m in arrivals(turned) if m.arrived >= 1.0]
    messages = sorted(first + second, key=lambda m: m.arrived)
    mixed = fed(LiveSession(robot), messages)
    np.testing.assert_allclose(mixed.trunk.inertial.vector, plain.trunk.inertial.vector, rtol=1e-9)


@pytest.mark.parametrize("jump", [-7.0, 3600.0])
def test_stamps_that_jump(robot: Robot, unloaded: list[Arrival], ros: list[Sent], jump: float) -> None:
    """The clock was set at 1 s: a quarter of a second is lost, and the estimate keeps what it knew."""
    shifted = [_shifted(m, jump) for m in unloaded if m.arrived >= 1.0]
    session = LiveSession(robot)
    before = fed(session, [m for m in unloaded if m.arrived < 1.0])
    after = goes_on(session, shifted, 2.0)
    assert (after.trunk.inertia_std < 0.95 * before.trunk.inertia_std).all()  # of which a new start would know less
    assert after.stamp == pytest.approx(1e9 * (1.996 + jump), abs=5e7)
    assert any("clock" in note for note in after.notes)


def test_stamps_that_stand_still(robot: Robot, unloaded: list[Arrival], plain: LiveState) -> None:
    """Headers that nobody filled in: times of arrival are used, as for a bag."""
    still = [_stamped(m, 0) for m in unloaded]
    state = goes_on(LiveSession(robot), still, 2.0)
    assert state.trunk.inertial.mass == pytest.approx(plain.trunk.inertial.mass, abs=0.1 * plain.trunk.mass_std)
    assert any("stamps of /joint_states repeat" in note for note in state.notes)


def test_messages_that_come_twice(robot: Robot, unloaded: list[Arrival], plain: LiveState) -> None:
    state = fed(LiveSession(robot), [m for one in unloaded for m in (one, one)])
    np.testing.assert_allclose(state.trunk.inertial.vector, plain.trunk.inertial.vector, rtol=1e-9)


@pytest.mark.parametrize("kind", ["ros", "lowstate"])
def test_the_last_message_counts_though_it_comes_alone(kind: str, robot: Robot, request: pytest.FixtureRequest) -> None:
    """Nothing follows it with which it could be taken in together."""
    messages, session = arrivals(request.getfixturevalue(kind)), LiveSession(robot)
    session.feed(messages[:-1])
    session.feed(messages[-1:])
    stamp = 3.396 if kind == "ros" else 1e-9 * messages[-1].received
    assert session.state(messages[-1].arrived).time == pytest.approx(stamp, abs=2e-3)


def _shifted(message: Arrival, jump: float) -> Arrival:
    content = bags.TYPES.deserialize_cdr(message.data, message.kind)
    stamp = content.header.stamp.sec * bags.NS + content.header.stamp.nanosec + round(jump * bags.NS)
    return _stamped(message, stamp)


def _stamped(message: Arrival, stamp: int) -> Arrival:
    content = bags.TYPES.deserialize_cdr(message.data, message.kind)
    content.header = type(content.header)(type(content.header.stamp)(*divmod(stamp, bags.NS)), content.header.frame_id)
    return message._replace(data=bytes(bags.TYPES.serialize_cdr(content, message.kind)))


def test_a_publisher_that_stops_and_begins_anew(robot: Robot, unloaded: list[Arrival]) -> None:
    """Its stamps begin anew as well, and so do the numbers of its messages."""
    session = LiveSession(robot)
    first = fed(session, [m for m in unloaded if m.arrived < 1.5])
    assert session.state(4.0).waiting_for == tuple(
        f"messages of {topic}, which have stopped" for topic in ("/joint_states", "/imu/data")
    )
    state = goes_on(session, later(unloaded, 5.0), 7.0)
    assert state.trunk.mass_std < 1.01 * first.trunk.mass_std
    assert not state.lost["network"]


def test_another_rate(robot: Robot, unloaded: list[Arrival]) -> None:
    slower = [m for k, m in enumerate(unloaded) if m.arrived < 0.6 or (k // 2) % 3 == 0]
    state = goes_on(LiveSession(robot), slower, 2.0, most=20)  # what it holds back meanwhile counts in pieces
    assert any("another rate" in note for note in state.notes)


def test_messages_without_torques(robot: Robot, walk: Recording, unloaded: list[Arrival]) -> None:
    told = [
        bags.joints(float(t), walk.joints, walk.position[k], topic="/joints") for k, t in enumerate(walk.time[:200])
    ]
    of_imu = [m for m in unloaded if m.kind == bags.IMU]
    state = fed(LiveSession(robot), sorted([*arrivals(told), *of_imu], key=lambda m: m.arrived))
    (lacking,) = state.waiting_for
    assert lacking == "/joints: its messages have no torques (effort), by which a robot is weighed"


def test_too_slow(robot: Robot, walk: Recording, unloaded: list[Arrival]) -> None:
    state = fed(
        LiveSession(robot), [m._replace(arrived=m.arrived) for m in unloaded[::1] if round(m.arrived / 0.004) % 8 == 0]
    )
    assert "50 are needed" in state.waiting_for[0]


@pytest.mark.parametrize("offset", [0.001, -30.0])
def test_a_second_publisher_is_left_out(robot: Robot, unloaded: list[Arrival], plain: LiveState, offset: float) -> None:
    """Of the same topics, on the same clock or on another one, and known by its attachments."""
    own = [m._replace(sent=Attached(k // 2, m.received, b"a" * 16)) for k, m in enumerate(unloaded)]
    other = [_shifted(m, offset)._replace(sent=Attached(k // 2, m.received, b"b" * 16)) for k, m in enumerate(unloaded)]
    both = [m for pair in zip(own, other, strict=True) for m in pair]
    mixed = fed(LiveSession(robot), both)
    np.testing.assert_allclose(mixed.trunk.inertial.vector, plain.trunk.inertial.vector, rtol=1e-9)
    assert mixed.lost["left out"] == len(other)
    assert any("second publisher" in note for note in mixed.notes)


def test_messages_on_another_clock_are_left_out(robot: Robot, unloaded: list[Arrival], plain: LiveState) -> None:
    """Of a second publisher behind the bridge, which does not say whose messages they are."""
    both = [m for one in unloaded for m in (one, _shifted(one, -30.0))]
    mixed = fed(LiveSession(robot), both)
    assert mixed.trunk.inertial.mass == pytest.approx(plain.trunk.inertial.mass, abs=plain.trunk.mass_std)
    assert mixed.time == pytest.approx(plain.time, abs=0.01)


def test_lost_and_damaged_messages_are_counted(robot: Robot, unloaded: list[Arrival]) -> None:
    numbered = [m._replace(sent=Attached(k // 2, m.received, b"a" * 16)) for k, m in enumerate(unloaded)]
    del numbered[400:420]
    numbered[600] = numbered[600]._replace(data=b"\0\1\0\0rubbish")
    state = goes_on(LiveSession(robot), numbered, 2.0)
    assert state.lost["network"] == 20
    assert state.lost["damaged"] == 1
    unnumbered = fed(LiveSession(robot), [m for k, m in enumerate(unloaded) if not 400 <= k < 420])
    assert unnumbered.lost["network"] == 10  # rows


def test_several_topics_of_joints(robot: Robot, unloaded: list[Arrival]) -> None:
    """Those of an arm are none of the robot's; a copy has to be chosen among."""
    arm = [bags.joints(0.004 * k, ["elbow"], [0.0], [0.0], [0.0], topic="/arm/joint_states") for k in range(500)]
    mixed = sorted(chain(unloaded, arrivals(arm)), key=lambda m: m.arrived)
    goes_on(LiveSession(robot), mixed, 2.0)
    copy = [m._replace(topic="/copy") for m in unloaded if m.topic == "/joint_states"]
    both = sorted(chain(unloaded, copy), key=lambda m: m.arrived)
    session = LiveSession(robot)
    early = fed(session, [m for m in both if m.arrived < 0.7]).waiting_for
    slower = [m._replace(received=round(1.01 * m.received)) for m in both if m.arrived >= 0.7]
    (lacking,) = fed(session, slower).waiting_for
    assert (lacking,) == early  # said once, though rates scatter
    assert "/copy (" in lacking
    assert "choose one with --joint-topic" in lacking
    goes_on(LiveSession(robot, Topics("joint_states")), both, 2.0)


def test_a_frame_that_the_model_does_not_have(robot: Robot, unloaded: list[Arrival], walk: Recording) -> None:
    unit = walk.imu
    assert unit is not None
    strange = [
        m._replace(
            data=bags.imu(
                m.arrived, unit.angular_velocity[k // 2], unit.linear_acceleration[k // 2], frame="camera"
            ).data
        )
        if m.topic == "/imu/data"
        else m
        for k, m in enumerate(unloaded)
    ]
    assert "camera" in fed(LiveSession(robot), strange).waiting_for[0]
    goes_on(LiveSession(robot, imu_frame=ImuMount.of(robot).name), strange, 2.0)


# -- requests ---------------------------------------------------------------------------------------------------------
def test_no_tare_before_anything_is_known_and_a_reset(robot: Robot, unloaded: list[Arrival]) -> None:
    session = LiveSession(robot)
    assert not session.tare().success
    fed(session, unloaded)
    assert session.tare().success
    assert session.state(2.0).payload is not None
    assert session.reset().success
    state = session.state(2.0)
    assert state.payload is None
    assert not state.trunk.observed.any()


def test_a_state_is_plain_json_and_text(robot: Robot, unloaded: list[Arrival]) -> None:
    session = LiveSession(robot)
    fed(session, unloaded)
    session.tare()
    for state in (LiveSession(robot).state(0.0), session.state(2.0)):
        assert json.loads(json.dumps(state.to_dict(), allow_nan=False))["trunk"]["frame"] == robot.trunk
    assert {
        "robot",
        "time",
        "status",
        "trunk",
        "payload",
        "changes",
        "trust",
        "rates",
        "lost",
        "lag",
        "waiting_for",
    } <= set(state.to_dict())
    assert state.figures()["trunk mass [kg]"].count("±") == 1
    assert str(state.to_dict()["spikes"]) == state.figures()["outliers replaced"]
    assert f"{state.to_dict()['impacts']:.2f}" == state.figures()["left out for impacts [s]"]


def test_a_person_reads_seconds_since_the_first_sample(robot: Robot, walk: Recording) -> None:
    stamped = replace(walk, time=walk.time + 1.7e9)
    session = LiveSession(robot)
    state = fed(session, arrivals(list(bags.of_recording(stamped))))
    assert state.time == pytest.approx(stamped.time[-1], abs=0.1)
    assert 0.0 < state.since(state.time) < walk.time[-1] - walk.time[0] + 0.1
    (change,) = state.changes
    assert f"{change.time - state.begin:.2f} s" in state.figures()["last change [kg]"]
    assert "17000" not in " ".join([*state.figures().values(), *live_lines(state, None), session.tare().message])
