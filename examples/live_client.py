"""Send a controller's sensor values to `stadera live` and read the payload, with Python 3.10 and zenoh alone.

stadera live --robot go2 --listen tcp/127.0.0.1:7447     # in one terminal
python examples/live_client.py tcp/127.0.0.1:7447        # in another; or `Stadera` from your own loop
"""

import json
import struct
import sys
import time

import zenoh

JOINTS = "0/joint_states/sensor_msgs::msg::dds_::JointState_/TypeHashNotSupported"
IMU = "0/imu/sensor_msgs::msg::dds_::Imu_/TypeHashNotSupported"


class Stadera:
    """Sends samples; `state` is the last state received, see docs/live.md."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        self.session = zenoh.open(config)
        self.state = {}
        self._subscriber = self.session.declare_subscriber("stadera/state", self._take)

    def send(self, t, names, q, dq, tau, gyro, accel, imu_frame=""):
        """One sample, in SI units: time, joints' positions, velocities, torques, IMU rates and specific force."""
        self.session.put(IMU, imu(t, gyro, accel, imu_frame))
        self.session.put(JOINTS, joint_state(t, names, q, dq, tau))

    def tare(self):
        """Makes the robot's present load the reference of the payload; returns success and a message."""
        for reply in self.session.get("stadera/tare", timeout=5.0):
            if reply.ok is not None:  # std_srvs/Trigger: a bool, and a string after its length
                data = reply.ok.payload.to_bytes()
                (length,) = struct.unpack_from("<I", data, 8)
                return bool(data[4]), data[12 : 11 + length].decode()
        return False, "nobody answers: is stadera live running?"

    def _take(self, sample):
        self.state = json.loads(sample.payload.to_bytes())


def joint_state(t, names, *channels):
    """A sensor_msgs/JointState in CDR; the channels are position, velocity and effort."""
    body = aligned(header(t, ""), 4) + struct.pack("<I", len(names))
    for name in names:
        body = string(body, name)
    for values in channels:
        body = aligned(body, 4) + struct.pack("<I", len(values))
        body = aligned(body, 8) + struct.pack(f"<{len(values)}d", *values)
    return b"\0\1\0\0" + body


def imu(t, gyro, accel, frame):
    """A sensor_msgs/Imu in CDR; a covariance that begins with -1 says that there is no orientation."""
    nothing, unknown = [0.0] * 9, [-1.0] + [0.0] * 8
    values = [0.0, 0.0, 0.0, 1.0, *unknown, *gyro, *nothing, *accel, *nothing]
    return b"\0\1\0\0" + aligned(header(t, frame), 8) + struct.pack("<37d", *values)


def header(t, frame):
    return string(struct.pack("<iI", *divmod(round(t * 1e9), 1_000_000_000)), frame)


def string(body, text):
    data = text.encode() + b"\0"
    return aligned(body, 4) + struct.pack("<I", len(data)) + data


def aligned(body, size):
    return body + b"\0" * (-len(body) % size)


def main(endpoint: str = "tcp/127.0.0.1:7447", seconds: str = "inf") -> None:
    stadera, tared, begun = Stadera(endpoint), False, time.monotonic()
    while time.monotonic() - begun < float(seconds):
        time.sleep(0.2)
        state = stadera.state
        if not state or state["waiting_for"]:
            print("; ".join(state.get("waiting_for", ["no state yet: is stadera live running, and listening?"])))
            continue
        if not tared:
            tared, said = stadera.tare()
            print(said)
        mass = (state["payload"] or {"mass": {"value": None, "std": None}})["mass"]
        print(f"{state['time']:.2f} s: payload {mass['value']} ± {mass['std']} kg, trust: {state['trust']['verdict']}")
    stadera.session.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
