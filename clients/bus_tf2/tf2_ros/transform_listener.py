"""Fills a buffer with the transforms that come on `/tf` and `/tf_static`.

Owns: the subscriptions and, if requested, a thread that spins them. Must not know: look-ups.
"""

import threading
from contextlib import suppress
from typing import Any

from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from bus_tf2.messages import message_type
from bus_tf2.tf2_py import BufferCore

__all__ = ["DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC", "TransformListener"]

DEFAULT_TF_TOPIC = "/tf"
DEFAULT_STATIC_TF_TOPIC = "/tf_static"

_AUTHORITY = "default_authority"


class TransformListener:
    """Passes received transforms to `buffer`, until `unregister`.

    `node`: the node for the subscriptions; None: a new node. `spin_thread`: spin that node in a separate
    thread. `qos` and `static_qos`: a profile or a depth, by default 100 messages, transient local for
    static transforms. `static_only`: receive only static transforms.
    """

    def __init__(
        self,
        buffer: BufferCore,
        node: Node | None,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int | None = None,
        static_qos: QoSProfile | int | None = None,
        tf_topic: str = DEFAULT_TF_TOPIC,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
        static_only: bool = False,
    ) -> None:
        self.buffer = buffer
        self.node = node = node or _own_node(id(self))
        # Not exclusive: another callback may wait for a transform received here.
        self.group = ReentrantCallbackGroup()
        kind = message_type("tf2_msgs/msg/TFMessage")
        if not static_only:
            self.tf_sub = node.create_subscription(
                kind,
                tf_topic,
                self.callback,
                qos or _profile(DurabilityPolicy.VOLATILE),
                callback_group=self.group,
            )
        self.tf_static_sub = node.create_subscription(
            kind,
            tf_static_topic,
            self.static_callback,
            static_qos or _profile(DurabilityPolicy.TRANSIENT_LOCAL),
            callback_group=self.group,
        )
        self.dedicated_listener_thread: threading.Thread | None = None
        if spin_thread:
            self.executor = SingleThreadedExecutor(context=node.context)
            # A daemon: the program's end does not wait for it.
            self.dedicated_listener_thread = threading.Thread(
                target=_spin, args=(self.executor, node), name="tf listener", daemon=True
            )
            self.dedicated_listener_thread.start()

    def unregister(self) -> None:
        """Stop receiving, and end the thread if there is one."""
        thread = self.dedicated_listener_thread
        if thread is not None and thread is not threading.current_thread():
            self.executor.shutdown()
            thread.join()
        for name in ("tf_sub", "tf_static_sub"):
            subscription = vars(self).pop(name, None)
            if subscription is not None:
                self.node.destroy_subscription(subscription)

    def callback(self, data: Any) -> None:
        for transform in data.transforms:
            self.buffer.set_transform(transform, _AUTHORITY)

    def static_callback(self, data: Any) -> None:
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, _AUTHORITY)


def _own_node(number: int) -> Node:
    return Node(
        f"transform_listener_impl_{number:010x}",
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )


def _profile(durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(depth=100, durability=durability, history=HistoryPolicy.KEEP_LAST)


def _spin(executor: SingleThreadedExecutor, node: Node) -> None:
    executor.add_node(node)
    with suppress(ExternalShutdownException):
        executor.spin()
    executor.remove_node(node)
