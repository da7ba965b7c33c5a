"""Sends transforms that are valid at all times on `/tf_static`."""

from typing import Any

from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from bus_tf2.messages import message_type
from bus_tf2.tf2_ros.transform_broadcaster import as_list

__all__ = ["StaticTransformBroadcaster"]


class StaticTransformBroadcaster:
    """Late listeners get every transform sent before. `qos`: a profile, or a depth."""

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        if qos is None:
            qos = QoSProfile(
                depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, history=HistoryPolicy.KEEP_LAST
            )
        self._message = message_type("tf2_msgs/msg/TFMessage")
        self.net_message = self._message()
        self.pub_tf = node.create_publisher(self._message, "/tf_static", qos)

    def sendTransform(self, transform: Any) -> None:
        """Send a TransformStamped, or several, together with the last earlier transform of each child frame.

        The reason: a late listener receives only one message.
        """
        sent = {one.child_frame_id: one for one in self.net_message.transforms}
        sent |= {one.child_frame_id: one for one in as_list(transform)}
        self.net_message.transforms = list(sent.values())
        self.pub_tf.publish(self.net_message)
