"""Waits in a test until messages came on some topics, with a separate context and node."""

import threading
import uuid
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Final, Self

__all__ = ["WaitForTopics"]

_KEPT: Final = 100
"""Messages of each topic, unless the caller says how many."""


class WaitForTopics:
    """`with WaitForTopics([("chatter", String)], timeout=5.0) as topics:` has a message of each topic.

    Without `with`, `wait` says whether they came; `shutdown` ends it.
    """

    def __init__(
        self,
        topic_tuples: Iterable[tuple[str, Any]],
        timeout: float = 5.0,
        messages_received_buffer_length: int = _KEPT,
        trigger: Callable[..., None] | None = None,
    ) -> None:
        """`trigger`: called with the node once all is subscribed to."""
        self._topics = list(topic_tuples)
        self._timeout = timeout
        self._news = threading.Condition()
        self._messages: dict[str, deque[Any]] = {
            name: deque(maxlen=messages_received_buffer_length) for name, _ in self._topics
        }
        self._trigger = trigger
        self._thread: threading.Thread | None = None

    def wait(self) -> bool:
        """Whether a message came on each topic within the time."""
        self._start()
        with self._news:
            return self._news.wait_for(lambda: not self.topics_not_received(), self._timeout)

    def received_messages(self, topic_name: str) -> list[Any]:
        """The newest messages of a topic, the oldest first. Raises KeyError for another topic."""
        return list(self._messages[topic_name])

    def topics_received(self) -> set[str]:
        return {name for name, messages in self._messages.items() if messages}

    def topics_not_received(self) -> set[str]:
        return set(self._messages) - self.topics_received()

    def shutdown(self) -> None:
        """Stop receiving."""
        if self._thread is None:
            return
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.try_shutdown()
        self._thread = None

    def __enter__(self) -> Self:
        if not self.wait():
            missing = self.topics_not_received()
            self.shutdown()
            raise RuntimeError(f"Did not receive messages on these topics: {missing}")
        return self

    def __exit__(self, *error: object) -> None:
        self.shutdown()

    def _start(self) -> None:
        if self._thread is not None:
            return
        import rclpy  # the facade, or the genuine one

        self._context = rclpy.context.Context()
        rclpy.init(args=[], context=self._context)  # `name:=value` in `sys.argv` is for the launch
        self._node = rclpy.create_node(f"wait_for_topics_{uuid.uuid4().hex}", context=self._context)
        for name, kind in self._topics:
            self._node.create_subscription(kind, name, self._callback_for(name), _KEPT)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="WaitForTopics", daemon=True)
        self._thread.start()
        if self._trigger is not None:
            self._trigger(self._node)

    def _callback_for(self, name: str) -> Callable[[Any], None]:
        def on_message(message: Any) -> None:
            with self._news:
                self._messages[name].append(message)
                self._news.notify_all()

        return on_message

    def _spin(self) -> None:
        import rclpy

        try:
            self._executor.spin()
        except (rclpy.executors.ExternalShutdownException, rclpy.executors.ShutdownException):
            pass
