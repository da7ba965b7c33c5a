"""A node of ROS 2's own rclpy, which does what it is told: `python ros.py NAME [NAMESPACE]`.

Arguments are texts, numbers and objects of JSON. A long array of numbers is an object with its size and the
CRC of its bytes; one to be sent may be just an object with its `size`.
"""

import importlib
import os
import signal
import sys
import threading
import time
from functools import partial
from typing import Any
from zlib import crc32

import rclpy
from orders import serve, tell
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

_LONG = 100


def profile_of(
    depth: int = 10, reliability: str = "reliable", durability: str = "volatile", **times_s: float
) -> QoSProfile:
    """`depth` 0 is keep all."""
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST if depth else HistoryPolicy.KEEP_ALL,
        reliability=ReliabilityPolicy[reliability.upper()],
        durability=DurabilityPolicy[durability.upper()],
        **{name: Duration(seconds=time_s) for name, time_s in times_s.items()},
    )


def class_of(type_name: str) -> Any:
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def as_values(value: Any) -> Any:
    """A message, or what is in one, for JSON."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: as_values(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value)
    if hasattr(value, "tobytes"):
        return {"size": len(value), "crc": crc32(value.tobytes())} if len(value) > _LONG else list(value)
    return [as_values(one) for one in value] if isinstance(value, list | tuple) else value


def fill(message: Any, values: dict[str, Any]) -> Any:
    """`message`, with what `values` has."""
    for name, value in values.items():
        held = getattr(message, name)
        if hasattr(held, "get_fields_and_field_types"):
            fill(held, value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            item = message.get_fields_and_field_types()[name].removeprefix("sequence<").rstrip(">")
            package, _, short = item.partition("/")
            made = class_of(f"{package}/msg/{short}")
            setattr(message, name, [fill(made(), one) for one in value])
        elif isinstance(value, dict):
            held.frombytes(bytes(number % 251 for number in range(value["size"])))
        else:
            setattr(message, name, value)
    return message


class Peer:
    """One node and its endpoints, which a thread spins."""

    def __init__(self, name: str, namespace: str = "") -> None:
        rclpy.init(args=[])
        self.node = rclpy.create_node(name, namespace=namespace or None)
        self._publishers: dict[str, Any] = {}
        self._subscriptions: dict[str, Any] = {}
        self._streams: dict[str, Any] = {}
        self._services: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self._nodes: list[Any] = []
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except (ExternalShutdownException, rclpy.executors.ShutdownException):
            pass

    def publish(self, topic: str, type_name: str, **qos: Any) -> None:
        """Make a publisher."""
        self._publishers[topic] = self.node.create_publisher(class_of(type_name), topic, profile_of(**qos))

    def listen(self, topic: str, type_name: str, **qos: Any) -> None:
        """Make a subscription, which tells what it hears."""
        self._subscriptions[topic] = self.node.create_subscription(
            class_of(type_name), topic, partial(self._hear, topic), profile_of(**qos)
        )

    def _hear(self, topic: str, message: Any, info: Any) -> None:
        time_ns = info["source_timestamp"] if isinstance(info, dict) else info.source_timestamp
        tell(heard=topic, message=as_values(message), source_time_ns=time_ns)

    def send(self, topic: str, *messages: dict[str, Any], **one: Any) -> None:
        publisher = self._publishers[topic]
        for values in (*messages, one):
            publisher.publish(fill(publisher.msg_type(), values))

    def stream(self, topic: str, hz: float) -> None:
        """Strings that are numbers, from 1, until `stop`."""
        publisher, number = self._publishers[topic], 0

        def publish() -> None:
            nonlocal number
            number += 1
            publisher.publish(publisher.msg_type(data=str(number)))

        self._streams[topic] = self.node.create_timer(1 / hz, publish)

    def stop(self, topic: str) -> None:
        self.node.destroy_timer(self._streams.pop(topic))

    def offer(self, service: str, type_name: str, pause_s: float = 0.0, **answer: Any) -> None:
        """Make a server that tells each request, and then always answers the same after `pause_s`."""
        cls = class_of(type_name)

        def on_request(request: Any, response: Any) -> Any:
            tell(heard=service, message=as_values(request))
            if pause_s:
                threading.Event().wait(pause_s)
            return fill(response, answer)

        self._services[service] = self.node.create_service(cls, service, on_request)

    def manage(self, name: str) -> None:
        """Make a lifecycle node, which tells its transitions. It fails to activate the first time."""
        failures = ["activate"]

        class Managed(LifecycleNode):  # type: ignore[misc]
            def on_configure(self, state: Any) -> Any:
                tell(heard=name, message="configure")
                return TransitionCallbackReturn.SUCCESS

            def on_activate(self, state: Any) -> Any:
                tell(heard=name, message="activate")
                if failures and failures.pop():
                    return TransitionCallbackReturn.FAILURE
                return super().on_activate(state)

        self._nodes.append(Managed(name))
        self._executor.add_node(self._nodes[-1])

    def call(self, service: str, type_name: str, count: int = 1, time_s: float = 10.0, **request: Any) -> Any:
        """Call a service once it is there, `count` times at once; None for an answer that did not come."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(class_of(type_name), service)
        client = self._clients[service]
        if not client.wait_for_service(time_s):
            return "no server"
        done, futures = threading.Semaphore(0), []
        for _ in range(count):
            future = client.call_async(fill(client.srv_type.Request(), request))
            future.add_done_callback(lambda _: done.release())
            futures.append(future)
        end = time.monotonic() + time_s
        for _ in range(count):
            done.acquire(timeout=max(end - time.monotonic(), 0))
        return [as_values(future.result()) if future.done() else None for future in futures]

    def serve_action(self, action: str, type_name: str, feedbacks: int = 2, pause_s: float = 0.0) -> None:
        """Make an action server for Fibonacci, in a separate node: feedbacks with pauses, then the result.

        It tells the order of each goal.
        """
        cls = class_of(type_name)

        def execute(goal: Any) -> Any:
            tell(heard=action, message=goal.request.order)
            for number in range(feedbacks):
                if goal.is_cancel_requested:
                    goal.canceled()
                    return cls.Result(sequence=[-1])
                goal.publish_feedback(cls.Feedback(sequence=[number]))
                threading.Event().wait(pause_s)
            goal.succeed()
            return cls.Result(sequence=[*range(goal.request.order)])

        self._serve_action(action, cls, execute)

    def echo_action(self, action: str, type_name: str) -> None:
        """Make an action server, in a separate node: one feedback and the result with the goal's fields."""
        cls = class_of(type_name)

        def execute(goal: Any) -> Any:
            values = as_values(goal.request)
            goal.publish_feedback(fill(cls.Feedback(), values))
            goal.succeed()
            return fill(cls.Result(), values)

        self._serve_action(action, cls, execute)

    def _serve_action(self, action: str, cls: Any, execute: Any) -> None:
        node = rclpy.create_node(f"{self.node.get_name()}_actions")
        self._services[action] = ActionServer(
            node,
            cls,
            action,
            execute,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=ReentrantCallbackGroup(),
        )
        executor = MultiThreadedExecutor(3)
        executor.add_node(node)
        threading.Thread(target=executor.spin, daemon=True).start()

    def send_goal(
        self, action: str, type_name: str, cancel_after: int = 0, time_s: float = 20.0, **goal: Any
    ) -> Any:
        """Send a goal once its server is there; cancel it after so many feedbacks.

        Returns its status, its result and the feedbacks.
        """
        cls = class_of(type_name)
        if action not in self._clients:
            self._clients[action] = ActionClient(self.node, cls, action)
        client = self._clients[action]
        if not client.wait_for_server(time_s):
            return "no server"
        feedbacks: list[Any] = []
        goals: list[Any] = []
        ends: list[Any] = []
        has_ended = threading.Event()

        def cancel() -> None:
            # Feedback may come before the answer that the goal was accepted.
            if cancel_after and goals and len(feedbacks) >= cancel_after:
                goals[0].cancel_goal_async()

        def on_feedback(message: Any) -> None:
            feedbacks.append(as_values(message.feedback))
            cancel()

        def on_accepted(future: Any) -> None:
            goals.append(future.result())
            if goals[0].accepted:
                goals[0].get_result_async().add_done_callback(on_end)
                cancel()
            else:
                has_ended.set()

        def on_end(future: Any) -> None:
            ends.append(future.result())
            has_ended.set()

        client.send_goal_async(fill(cls.Goal(), goal), on_feedback).add_done_callback(on_accepted)
        if not has_ended.wait(time_s):
            return "no end"
        return [ends[0].status, as_values(ends[0].result), feedbacks] if ends else "rejected"

    def has_server(self, service: str, type_name: str) -> bool:
        """Whether a client of it is matched with a server."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(class_of(type_name), service)
        return bool(self._clients[service].service_is_ready())

    def servers(self, service: str) -> int:
        """How many servers there are, by the node's own graph."""
        return int(self.node.count_services(service))

    def end(self, topic: str) -> None:
        """The endpoints go."""
        if topic in self._services:
            self.node.destroy_service(self._services.pop(topic))
        if topic in self._clients:
            self.node.destroy_client(self._clients.pop(topic))
        if topic in self._publishers:
            self.node.destroy_publisher(self._publishers.pop(topic))
        if topic in self._subscriptions:
            self.node.destroy_subscription(self._subscriptions.pop(topic))

    def end_all(self) -> None:
        """The node goes, and says so: others need not wait for its lease."""
        self._executor.shutdown()
        self._thread.join(5.0)
        for node in self._nodes:
            node.destroy_node()
        self._executor.remove_node(self.node)
        self.node.destroy_node()
        rclpy.try_shutdown()

    def matched(self, topic: str) -> list[int]:
        """How many subscriptions and publishers there are, by the node's own graph."""
        return [self.node.count_subscribers(topic), self.node.count_publishers(topic)]

    def nodes(self) -> list[str]:
        """Full names, sorted, as `ros2 node list` has them: hidden ones are left out."""
        found = self.node.get_node_names_and_namespaces()
        return sorted(f"{space.rstrip('/')}/{name}" for name, space in found if not name.startswith("_"))

    def topics(self) -> dict[str, list[str]]:
        """Names and types, as `ros2 topic list -t` has them."""
        return dict(self.node.get_topic_names_and_types())

    def info(self, topic: str) -> list[dict[str, Any]]:
        """The publishers and subscriptions of a topic, as `ros2 topic info -v` has them."""
        found = [
            *self.node.get_publishers_info_by_topic(topic),
            *self.node.get_subscriptions_info_by_topic(topic),
        ]
        return [
            {
                "kind": one.endpoint_type.name.lower(),
                "node": f"{one.node_namespace.rstrip('/')}/{one.node_name}",
                "type": one.topic_type,
                "gid": bytes(one.endpoint_gid[:16]).hex(),
                "reliability": one.qos_profile.reliability.name.lower(),
                "durability": one.qos_profile.durability.name.lower(),
            }
            for one in found
        ]

    def services(self, name: str = "", namespace: str = "/") -> dict[str, list[str]]:
        """Names and types, as `ros2 service list -t` has them; with a name, those of that node."""
        node = self.node
        found = (
            node.get_service_names_and_types_by_node(name, namespace)
            if name
            else node.get_service_names_and_types()
        )
        return dict(found)

    def of_node(self, name: str, namespace: str = "/") -> list[dict[str, list[str]]]:
        """Topics that a node publishes, and those it subscribes to."""
        return [
            dict(self.node.get_publisher_names_and_types_by_node(name, namespace)),
            dict(self.node.get_subscriber_names_and_types_by_node(name, namespace)),
        ]


def main() -> None:
    peer = Peer(*sys.argv[1:])
    orders = (
        "publish",
        "listen",
        "send",
        "stream",
        "stop",
        "offer",
        "manage",
        "call",
        "serve_action",
        "echo_action",
        "send_goal",
        "services",
        "has_server",
        "servers",
        "end",
        "matched",
        "nodes",
        "topics",
        "info",
        "of_node",
    )
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    serve({order: getattr(peer, order) for order in orders})
    peer.end_all()
    sys.stdout.flush()
    os._exit(0)  # what rclpy's threads do while Python ends is not looked at here


if __name__ == "__main__":
    main()
