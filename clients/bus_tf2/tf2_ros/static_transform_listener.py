"""A listener that receives only static transforms."""

from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile
from bus_tf2.tf2_py import BufferCore
from bus_tf2.tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, TransformListener

__all__ = ["StaticTransformListener"]


class StaticTransformListener(TransformListener):
    """See TransformListener."""

    def __init__(
        self,
        buffer: BufferCore,
        node: Node | None,
        *,
        spin_thread: bool = False,
        static_qos: QoSProfile | int | None = None,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
    ) -> None:
        super().__init__(
            buffer,
            node,
            spin_thread=spin_thread,
            static_qos=static_qos,
            tf_static_topic=tf_static_topic,
            static_only=True,
        )
