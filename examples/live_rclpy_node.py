"""A ROS 2 node for `stadera live`: follows the payload, tares, and gives a controller the inertia it needs.

ros2 run rmw_zenoh_cpp rmw_zenohd                         # or zenoh-bridge-ros2dds, for nodes that speak DDS
stadera live --robot go2
python3 examples/live_rclpy_node.py --ros-args -p tare:=true
"""

try:
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import InertiaStamped
    from rclpy.node import Node
    from std_srvs.srv import Trigger
except ModuleNotFoundError as missing:
    raise SystemExit(f"{missing}: run it where ROS 2 is sourced") from None


class PayloadFollower(Node):
    """Keeps the trunk with its payload: inertia about the centre of mass, in the trunk's axes."""

    def __init__(self) -> None:
        super().__init__("payload_follower")
        self.trunk: InertiaStamped | None = None
        self.create_subscription(InertiaStamped, "stadera/trunk", self.on_trunk, 10)
        self.create_subscription(InertiaStamped, "stadera/payload", self.on_payload, 10)
        self.create_subscription(DiagnosticArray, "stadera/diagnostics", self.on_diagnostics, 10)
        self.tare_client = self.create_client(Trigger, "stadera/tare")
        self.declare_parameter("tare", False)
        self.ready = False
        if self.get_parameter("tare").value:
            self.timer = self.create_timer(1.0, self.tare)

    def on_trunk(self, message: InertiaStamped) -> None:
        """Keeps the last trunk while there are no trusted figures, since none are sent then."""
        self.trunk = message

    def on_payload(self, message: InertiaStamped) -> None:
        body = message.inertia  # NaN where a component of the centre of mass, or the inertia, was not observed
        self.get_logger().info(f"payload {body.m:.2f} kg at ({body.com.x:.3f}, {body.com.y:.3f}, {body.com.z:.3f}) m")

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        self.ready = status.level == b"\x00"
        if not self.ready:
            self.get_logger().warn(status.message, throttle_duration_sec=1.0)

    def tare(self) -> None:
        """Tares once, as soon as the trunk is known."""
        if not (self.ready and self.tare_client.service_is_ready()):
            return
        self.timer.cancel()
        answer = self.tare_client.call_async(Trigger.Request())
        answer.add_done_callback(lambda future: self.get_logger().info(future.result().message))


def main() -> None:
    rclpy.init()
    rclpy.spin(PayloadFollower())


if __name__ == "__main__":
    main()
