"""A robot on Zenoh, in a process of its own: publishes a log's samples as rmw_zenoh or zenoh-bridge-ros2dds would.

python publisher.py LOG ENDPOINT KIND [options], where KIND is "ros" (JointState and Imu), "bridge" (the same by plain
keys and the bridge's tokens) or "lowstate" (by the bridge). Prints "ready" once somebody subscribes, before the first
message, and "done" after the last.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import zenoh

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bags import IMU, JOINT_STATE, TYPES, Sent, imu, joints, low_state
from stadera.joint_words import matched
from stadera.live import keys
from stadera.logs import Recording, read
from stadera.logs.bags.unitree import MOTORS

LOW_STATE = "unitree_go/msg/LowState"


def messages(log: Recording, kind: str, shift: float, known: slice) -> Iterator[tuple[float, list[Sent]]]:
    """Each sample's time and messages; stamps are later by `shift` [s], joints those of `known`."""
    unit = log.imu
    assert unit is not None
    motors = [log.joints.index(name) for name in (matched(MOTORS, log.joints) or {}).values()]
    for k, time_ in enumerate(log.time):
        q, dq, tau = (getattr(log, name)[k] for name in ("position", "velocity", "effort"))
        gyro, force = unit.angular_velocity[k], unit.linear_acceleration[k]
        stamp = float(time_) + shift
        if kind == "lowstate":
            yield stamp, [low_state(stamp, q[motors], dq[motors], tau[motors], imu=(gyro, force))]
        else:
            names = log.joints[known]
            yield (
                stamp,
                [
                    imu(stamp, gyro, force, frame=unit.frame or "", known=(False, True, True)),
                    joints(stamp, names, q[known], dq[known], tau[known]),
                ],
            )


def opened(endpoint: str, how: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    config.insert_json5("listen/endpoints", json.dumps([endpoint] if how == "listen" else []))
    config.insert_json5("connect/endpoints", json.dumps([endpoint] if how == "connect" else []))
    return zenoh.open(config)


class Robot:
    """Publishes messages in the way of one of the two."""

    def __init__(self, session: zenoh.Session, kind: str, publisher: bytes) -> None:
        self.session, self.kind, self.publisher, self.number = session, kind, publisher, {}
        self.publishers, self.tokens = {}, []

    def announce(self, topic: str, ros: str) -> None:
        own, key = str(self.session.zid()), topic.strip("/")
        token = f"@/{own}/@ros2_lv/MP/{key.replace('/', '§')}/{ros.replace('/', '§')}/:::"
        if self.kind == "ros":
            key = keys.topic_key(0, topic, ros, TYPES.hash_rihs01(ros))
            token = keys.token(0, own, len(self.publishers) + 1, "MP", key)
        self.tokens.append(self.session.liveliness().declare_token(token))
        block = zenoh.CongestionControl.BLOCK
        self.publishers[topic] = self.session.declare_publisher(key, congestion_control=block)

    def wait(self) -> None:
        """Until somebody subscribes to all topics."""
        while not all(publisher.matching_status.matching for publisher in self.publishers.values()):
            time.sleep(0.01)

    def put(self, sent: Sent, stamp: int) -> None:
        attachment = None
        if self.kind == "ros":
            self.number[sent.topic] = self.number.get(sent.topic, 0) + 1
            attachment = keys.attachment(keys.Sent(self.number[sent.topic], stamp, self.publisher))
        self.publishers[sent.topic].put(sent.data, attachment=attachment)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("log", type=Path)
    parser.add_argument("endpoint")
    parser.add_argument("kind", choices=("ros", "bridge", "lowstate"))
    parser.add_argument("--how", choices=("listen", "connect"), default="listen")
    parser.add_argument("--rate", type=float, default=1.0, help="how much faster than the log")
    parser.add_argument("--shift", type=float, default=0.0, help="added to stamps [s]")
    parser.add_argument("--begin", type=float, default=0.0, help="of the log's time [s]")
    parser.add_argument("--end", type=float, default=1e9)
    parser.add_argument("--joints", default=":", help="slice of the joints that are published")
    parser.add_argument("--stay", action="store_true", help="do not end before stdin does")
    args = parser.parse_args()
    log = read(args.log)
    inside = (log.time >= args.begin) & (log.time < args.end)
    log = log.mapped(lambda _, values: values[inside])
    first, last = (int(word) if word else None for word in args.joints.split(":"))
    session = opened(args.endpoint, args.how)
    robot = Robot(session, args.kind, (b"%016x" % time.monotonic_ns())[:16])
    topics = {"/lowstate": LOW_STATE} if args.kind == "lowstate" else {"/joint_states": JOINT_STATE, "/imu/data": IMU}
    for topic, ros in topics.items():
        robot.announce(topic, ros)
    ready = list(messages(log, args.kind, args.shift, slice(first, last)))
    robot.wait()
    print("ready", flush=True)
    begun, start = time.monotonic(), ready[0][0]
    for stamp, sent in ready:
        if (ahead := begun + (stamp - start) / args.rate - time.monotonic()) > 0:
            time.sleep(ahead)
        for message in sent:
            robot.put(message, time.time_ns())
    print("done", flush=True)
    if args.stay:
        sys.stdin.read()
    session.close()


if __name__ == "__main__":
    main()
