"""Wait sets, and the entities that a program adds to them: without callbacks, as in rclpy's C library.

A program takes their data itself. Owns which entities are ready, and notifies listeners; the native
publishers, subscriptions, clients and servers do the rest.
"""

from collections import deque
from collections.abc import Callable
from time import monotonic_ns
from types import SimpleNamespace
from typing import Any

from bus.endpoint.endpoint import core_of
from bus_ros.engine import Waiter, engine
from bus_ros.entity import Entity
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.qos import to_native
from bus_ros.rclpy.timer import Timer as FacadeTimer

__all__ = [
    "Client",
    "GuardCondition",
    "Publisher",
    "Service",
    "Source",
    "Subscription",
    "Timer",
    "WaitSet",
    "WaitableEntity",
]

_FOREVER_NS = 1 << 62
_INFO = (
    "source_timestamp",
    "received_timestamp",
    "publication_sequence_number",
    "reception_sequence_number",
)
"""Information about a message, as for a callback with two arguments."""


class Source(Handle):
    """An object that becomes ready. Listeners are called under the engine's guard, and once."""

    def __init__(self, close: Callable[[], Any] | None = None) -> None:
        super().__init__(lambda: self._is_closed, self._close)
        self._is_closed = False
        self._close_native = close
        self._listeners: list[Callable[[], object]] = []

    def is_ready(self) -> bool:
        raise NotImplementedError

    def listen(self, callback: Callable[[], object]) -> None:
        """Call `callback` the next time this becomes ready."""
        if callback not in self._listeners:
            self._listeners.append(callback)

    def _notify(self) -> None:
        listeners, self._listeners = self._listeners, []
        for callback in listeners:
            callback()

    def _close(self) -> None:
        self._is_closed = True
        if self._close_native is not None:
            engine().run(self._close_native)


class GuardCondition(Source):
    """Ready from `trigger_guard_condition` until a wait set has seen it."""

    def __init__(self, context: Handle) -> None:
        super().__init__()
        self._is_triggered = False

    def trigger_guard_condition(self) -> None:
        self.check()
        self._is_triggered = True
        engine().call(self._notify)

    def is_ready(self) -> bool:
        was_triggered, self._is_triggered = self._is_triggered, False
        return was_triggered


class Timer(Source):
    """Ready after each `period_ns` of the clock, until it is called."""

    def __init__(self, clock: Handle, context: Handle, period_ns: int, autostart: bool = True) -> None:
        super().__init__()
        nobody: Any = SimpleNamespace(own_executor=None, destroy_timer=lambda timer: True)
        group: Any = None
        self._timer = FacadeTimer(
            lambda: None, group, period_ns, clock.owner, node=nobody, autostart=autostart
        )

    def is_ready(self) -> bool:
        return self._timer.is_ready()

    is_timer_ready = is_ready

    def listen(self, callback: Callable[[], object]) -> None:
        super().listen(callback)
        due_ns = self._timer.wake_ns()
        if due_ns:
            engine().loop.call_later(max(due_ns - monotonic_ns(), 0) / 1e9, self._notify)

    def call_timer(self) -> None:
        """Begin the next period."""
        self._timer.take(1)

    def cancel_timer(self) -> None:
        self._timer.cancel()

    def reset_timer(self) -> None:
        self._timer.reset()

    def is_timer_canceled(self) -> bool:
        return self._timer.is_canceled()

    def time_since_last_call(self) -> int:
        return self._timer.time_since_last_call()

    def time_until_next_call(self) -> int | None:
        return self._timer.time_until_next_call()

    def get_timer_period(self) -> int:
        return self._timer.timer_period_ns

    def change_timer_period(self, period_ns: int) -> None:
        self._timer.timer_period_ns = period_ns


class Publisher(Handle):
    """A publisher without other functions."""

    def __init__(self, node: Handle, msg_type: Any, topic: str, qos_profile: Any) -> None:
        self._publisher = node.owner.create_publisher(msg_type, topic, qos_profile.profile)
        super().__init__(lambda: self._publisher.is_destroyed, self._publisher.destroy, self._publisher)

    def publish(self, message: Any) -> None:
        self._publisher.publish(message)

    publish_raw = publish

    def get_subscription_count(self) -> int:
        return self._publisher.get_subscription_count()  # type: ignore[no-any-return]

    def get_topic_name(self) -> str:
        return self._publisher.topic_name  # type: ignore[no-any-return]


class Subscription(Source):
    """Ready while messages wait."""

    def __init__(self, node: Handle, msg_type: Any, topic: str, qos_profile: Any) -> None:
        native_node = node.owner.native
        self.native: Any = engine().run(
            lambda: native_node.create_subscription(msg_type, topic, to_native(qos_profile.profile))
        )
        super().__init__(self.native.close)
        self._next: Any = None
        with engine().loop:
            self.native.set_arrival_callback(self._notify)

    def is_ready(self) -> bool:
        with engine().loop:
            self._next = self._next or self.native.take()
        return self._next is not None

    def take_message(self, msg_type: Any, raw: bool) -> tuple[Any, dict[str, int]] | None:
        """The next message and information about it; None if none waits."""
        if not self.is_ready():
            return None
        (message, info), self._next = self._next, None
        return message, {name: getattr(info, name) for name in _INFO}

    def get_publisher_count(self) -> int:
        with engine().loop:
            return self.native.get_publisher_count()  # type: ignore[no-any-return]

    def get_topic_name(self) -> str:
        return self.native.topic_name  # type: ignore[no-any-return]


class Client(Source):
    """Ready while answers wait."""

    def __init__(self, node: Handle, srv_type: Any, srv_name: str, qos_profile: Any) -> None:
        native_node = node.owner.native
        self._answers: deque[tuple[int, Any]] = deque()
        self._native: Any = engine().run(
            lambda: native_node.create_client(
                srv_type,
                srv_name,
                to_native(qos_profile.profile, for_both=True),
                on_response=self._on_response,
            )
        )
        super().__init__(self._native.close)

    @property
    def service_name(self) -> str:
        return self._native.service_name  # type: ignore[no-any-return]

    def is_ready(self) -> bool:
        return bool(self._answers)

    def send_request(self, request: Any) -> int:
        """Send a request; returns the number of the call."""
        self.check()
        with engine().loop:
            return self._native.send_request(request)  # type: ignore[no-any-return]

    def service_server_is_available(self) -> bool:
        with engine().loop:
            return self._native.service_is_ready()  # type: ignore[no-any-return]

    def take_response(self, response_type: Any) -> tuple[Any, Any]:
        """The number of a call, as `header.request_id.sequence_number`, and its answer.

        Returns None, None if there is none. Raises the error of the service.
        """
        if not self._answers:
            return None, None
        number, outcome = self._answers.popleft()
        if isinstance(outcome, Exception):
            raise outcome
        return SimpleNamespace(request_id=SimpleNamespace(sequence_number=number)), outcome

    def _on_response(self, number: int, outcome: object) -> None:
        self._answers.append((number, outcome))
        self._notify()


class Service(Source):
    """Ready while requests wait."""

    def __init__(self, node: Handle, srv_type: Any, srv_name: str, qos_profile: Any) -> None:
        native_node = node.owner.native
        self._requests: deque[tuple[Any, Any]] = deque()
        self._native: Any = engine().run(
            lambda: native_node.create_service(
                srv_type,
                srv_name,
                qos=to_native(qos_profile.profile, for_both=True),
                on_request=self._on_request,
            )
        )
        super().__init__(self._native.close)

    @property
    def name(self) -> str:
        return self._native.service_name  # type: ignore[no-any-return]

    def is_ready(self) -> bool:
        return bool(self._requests)

    def service_take_request(self, request_type: Any) -> tuple[Any, Any]:
        """The next request, and its header; None, None if none waits."""
        if not self._requests:
            return None, None
        request, request_id = self._requests.popleft()
        return request, SimpleNamespace(request_id=request_id)

    def service_send_response(self, response: Any, request_id: Any) -> None:
        """Answer the request with the `request_id` of its header."""
        with engine().loop:
            core_of(self._native).answer(request_id, response)

    def _on_request(self, request: object, request_id: Any) -> None:
        self._requests.append((request, request_id))
        self._notify()


class Calls(Source):
    """Ready while an entity of an action has calls to make, which no executor makes."""

    def __init__(self, entity: Entity) -> None:
        super().__init__()
        self._entity = entity
        self._next: Any = None

    def is_ready(self) -> bool:
        with engine().loop:
            self._next = self._next or self._entity.take(1)
        return self._next is not None

    def take_call(self) -> Any:
        """The next call, a function and its arguments; None if there is none."""
        self.is_ready()
        found, self._next = self._next, None
        return found

    def come(self) -> None:
        """Under the guard: note that the entity may have calls."""
        self._notify()


class WaitSet(Handle):
    """A set of entities to wait for; the arguments, numbers of each kind, are not needed here."""

    def __init__(self, *_: Any) -> None:
        super().__init__(lambda: self._is_closed, self._close)
        self._is_closed = False
        self._sources: dict[str, list[Source]] = {}
        self._ready: dict[Source, bool] = {}

    def _close(self) -> None:
        self._is_closed = True

    def _add(self, kind: str, source: Any) -> int:
        if not isinstance(source, Source):
            raise TypeError(f"a wait set takes entities of rclpy_implementation, not {type(source).__name__}")
        if source._is_closed:
            raise InvalidHandle("cannot use Destroyable because destruction was requested")
        self._sources.setdefault(kind, []).append(source)
        return len(self._sources[kind]) - 1

    # Each returns the entity's index, for `is_ready`.

    def add_subscription(self, subscription: Any) -> int:
        return self._add("subscription", subscription)

    def add_guard_condition(self, guard_condition: Any) -> int:
        return self._add("guard_condition", guard_condition)

    def add_timer(self, timer: Any) -> int:
        return self._add("timer", timer)

    def add_client(self, client: Any) -> int:
        return self._add("client", client)

    def add_service(self, service: Any) -> int:
        return self._add("service", service)

    def add_event(self, event: Any) -> int:
        return self._add("event", event)

    def add_action(self, calls: "Calls") -> int:
        return self._add("action", calls)

    def clear_entities(self) -> None:
        self._sources, self._ready = {}, {}

    def is_ready(self, kind: str, index: int) -> bool:
        """Whether the entity was ready at the last `poll`."""
        return self._ready.get(self._sources[kind][index], False)

    def get_ready_entities(self, kind: str) -> list[int]:
        """The pointers of the ready entities."""
        return [one.pointer for one in self._sources.get(kind, ()) if self._ready.get(one)]

    def wait(self, timeout_ns: int) -> None:
        """Wait at most `timeout_ns` until an entity is ready; negative: for ever."""
        mover, end_ns = engine(), _FOREVER_NS if timeout_ns < 0 else monotonic_ns() + timeout_ns
        while not self.poll() and monotonic_ns() < end_ns:
            with mover.loop:
                waiter = Waiter(mover)
                self.listen(waiter.set)
            if self.poll():
                return
            with mover.loop:
                waiter.wait(end_ns if timeout_ns >= 0 else 0)

    def poll(self) -> bool:
        """Check which entities are ready; returns whether any is."""
        every = [source for sources in self._sources.values() for source in sources]
        self._ready = {source: source.is_ready() for source in every}
        return any(self._ready.values())

    def listen(self, callback: Callable[[], object]) -> None:
        """Call `callback` when an entity becomes ready. Under the guard."""
        for sources in self._sources.values():
            for source in sources:
                source.listen(callback)


class WaitableEntity(Entity):
    """A Waitable in its node's list: its calls are the program's `take_data` and `execute`."""

    is_async = True
    is_single = True

    def __init__(self, waitable: Any, node: Any) -> None:
        super().__init__(node, waitable.callback_group)
        self.waitable = waitable

    def take(self, most: int) -> Any:
        return self._poll, ()

    async def _poll(self) -> None:
        wait_set = WaitSet()
        self.waitable.add_to_wait_set(wait_set)
        with engine().loop:
            wait_set.listen(self.notify)
        if not wait_set.poll():
            return
        if self.waitable.is_ready(wait_set):
            taken = self.waitable.take_data()
            await self.waitable.execute(taken)
        engine().call(self.notify)  # there may be more
