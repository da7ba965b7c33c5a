"""The publisher and the subscription of a node for scripts: each call waits until it is done.

Owns the loop's turns around a message: the message comes first, all other work later.
"""

import time
from collections.abc import Iterator
from threading import get_ident
from time import monotonic_ns
from typing import Any, Generic, TypeVar

import msgspec

from bus.endpoint.core import EndpointCore
from bus.endpoint.endpoint import core_of
from bus.endpoint.matches import Match
from bus.endpoint.publisher_core import PublisherCore
from bus.endpoint.subscription_core import SubscriptionCore
from bus.errors import again
from bus.events import MatchedChange, PublisherEvents
from bus.node import Node
from bus.process.foreground import Condition, Foreground, Signal, deadline_after
from bus.publisher import Publisher, PublisherStatistics
from bus.qos import Durability, QoS
from bus.schema import MessageSchema
from bus.subscription import MessageInfo, Subscription, SubscriptionStatistics

M = TypeVar("M", bound=msgspec.Struct)

_SEND_NS = 1_000_000_000
"""Longest wait of a message until the socket accepts it."""
_LEAST_PAUSE_S, _MOST_PAUSE_S = 0.001, 0.05
"""Pauses between two attempts of another thread for which there is no room."""

_READY_NS = 1_000_000_000
"""Longest wait of a message until new subscriptions can be woken."""

_RETURN_NS, _PAUSE_NS = 100_000_000, 1_000_000_000
"""Longest wait of a message for a busd that is away, and the pause after that, in which no message waits."""


class _BlockingEndpoint:
    """The common part of publisher and subscription."""

    _native: Publisher[Any] | Subscription[Any]
    _core: EndpointCore[Any]

    def __init__(self, foreground: Foreground) -> None:
        self._foreground = foreground
        self._loop = foreground.loop
        self._guard = foreground.loop.guard

    def __repr__(self) -> str:
        return f"<Blocking{repr(self._native)[1:]}"

    @property
    def topic_name(self) -> str:
        """The full name of its topic."""
        return self._native.topic_name

    @property
    def matches(self) -> tuple[Match, ...]:
        """The endpoints that this one is matched with now."""
        return self._native.matches


class BlockingPublisher(_BlockingEndpoint, Generic[M]):
    """Publishes messages of one type on one topic; made by `BlockingNode.create_publisher`.

    For example:

        publisher.wait_for_subscriptions(timeout=5)
    """

    _native: Publisher[M]
    _core: PublisherCore[M]

    def __init__(self, foreground: Foreground) -> None:
        super().__init__(foreground)
        self._has_new_matches = False
        self._next_try_ns = 0

    def publish(self, message: M, timeout: float | None = None) -> None:
        """Publish `message`, from any thread. On return it is in the ring, and sent to socket subscriptions.

        If the QoS is reliable + keep all and there is no room, it waits until the subscriptions take more,
        for up to `timeout` seconds. TimeoutError means that the message was not published. Also raises the
        errors of `bus.Publisher.publish`.
        """
        core = self._core
        sender = core.sender
        with self._guard:
            is_taken = sender.quick.publish(message)
            if is_taken is not True:
                is_taken = self._native._publish_on(message, is_taken)
            if sender.goes_by_socket:
                self._send()
        if self._loop.is_interrupted:
            self._loop.check()
        # A reader waits for the message, so all other work comes after it.
        if self._foreground.is_free():
            self._foreground.attend_often()
            if self._has_new_matches or not core.id:
                self._reach()
        if not is_taken:
            self._wait_for_room(message, timeout)

    def wait_for_subscriptions(self, number: int = 1, timeout: float | None = None) -> None:
        """Wait until at least `number` subscriptions are matched and can be woken.

        Raises TimeoutError after `timeout` seconds.
        """
        native = self._native
        self._foreground.run_or_tell(
            lambda: native.wait_for_subscriptions(number),
            timeout,
            lambda: f"{native.get_subscription_count()} of {number} subscriptions to '{self.topic_name}'",
        )

    def get_subscription_count(self) -> int:
        """Subscriptions matched now."""
        self._foreground.attend()
        return self._native.get_subscription_count()

    def statistics(self) -> PublisherStatistics:
        """Its totals."""
        return self._native.statistics()

    def close(self) -> None:
        """Hand over published messages, leave the graph. Closing twice is allowed."""
        if self._core.refusal is None:
            warn_if_unreceived(self)
            self._foreground.run(self._native.close)

    # --- inside

    def _matched(self, change: MatchedChange) -> None:
        self._has_new_matches |= change.current_count_change > 0

    def _send(self) -> None:
        """Under the guard: send gathered samples now, and wait until a long message has left."""
        link = self._core.link
        self._core.hand_over()  # a history would wait until the loop runs again
        link.hand_over()
        if link.is_writing and self._foreground.is_free():
            self._foreground.wait(Condition(lambda: not link.is_writing), monotonic_ns() + _SEND_NS)

    def _reach(self) -> None:
        """Give busd time to come back, and new subscriptions time to attach, which wakes them.

        A script that sleeps after each message does not run the loop at other times. The bounds prevent a
        delay of every message.
        """
        core, wait = self._core, self._foreground.wait
        now_ns = monotonic_ns()
        with self._guard:
            if not core.id and now_ns >= self._next_try_ns:
                wait(Condition(lambda: core.id != 0), now_ns + _RETURN_NS)
                self._next_try_ns = monotonic_ns() + _PAUSE_NS
            if self._has_new_matches:
                self._has_new_matches = False
                all_are_ready = Condition(lambda: core.count_ready() == len(core.matches))
                wait(all_are_ready, now_ns + _READY_NS)

    def _wait_for_room(self, message: M, timeout: float | None) -> None:
        if get_ident() != self._foreground.thread:
            self._try_again(message, timeout)
            return
        self._foreground.run_or_tell(
            lambda: self._native.send(message), timeout, lambda: f"no room on '{self.topic_name}'"
        )

    def _try_again(self, message: M, timeout: float | None) -> None:
        """Publish in another thread, which can't run the event loop, as soon as there is room."""
        deadline_ns, pause_s = deadline_after(timeout), _LEAST_PAUSE_S
        while True:
            left_s = (deadline_ns - monotonic_ns()) / 1e9 if deadline_ns else pause_s
            if left_s <= 0:
                raise TimeoutError(f"no room on '{self.topic_name}' within {timeout:g} s")
            time.sleep(min(pause_s, left_s))
            with self._guard:
                is_taken = self._native.publish(message)
                self._core.refused -= not is_taken  # it tries again
                if self._core.sender.goes_by_socket:
                    self._send()
            if is_taken:
                return
            pause_s = min(2 * pause_s, _MOST_PAUSE_S)


async def make_publisher(
    foreground: Foreground, node: Node, message_type: type[M] | MessageSchema, topic: str, qos: QoS
) -> BlockingPublisher[M]:
    """Make a publisher for BlockingNode."""
    made: BlockingPublisher[M] = BlockingPublisher(foreground)
    events = PublisherEvents(matched=made._matched)
    made._native = await node.create_publisher(message_type, topic, qos, events=events)
    made._core = core_of(made._native)
    return made


def warn_if_unreceived(publisher: BlockingPublisher[Any]) -> None:
    """Warn if the script ends before any subscription has received the publisher's messages."""
    core = core_of(publisher)
    if core.matches.total or core.qos.durability is not Durability.VOLATILE or core.refusal is not None:
        return
    if count := core.statistics().published:
        what = "a message was" if count == 1 else f"{count} messages were"
        core.logger.warning(
            f"{what} published on '{core.topic_name}' and reached nobody: no subscription was there"
            " (wait_for_subscriptions waits for one)"
        )


class BlockingSubscription(_BlockingEndpoint, Generic[M]):
    """Receives messages of one type on one topic; made by `BlockingNode.create_subscription`.

    `for message in subscription` waits for each message without a time limit; `listen` takes a timeout.

        for message in subscription.listen(timeout=1):
            print(message.data)
    """

    _native: Subscription[M]
    _core: SubscriptionCore[M]

    def __init__(self, foreground: Foreground, native: Subscription[M]) -> None:
        super().__init__(foreground)
        self._native = native
        self._core = core = core_of(native)
        self._receiver = core.receiver
        self._arrival = Signal()
        core.on_arrival = core.on_end = self._arrival.set

    def __iter__(self) -> Iterator[M]:
        return self.listen()

    def listen(self, timeout: float | None = None) -> Iterator[M]:
        """Yield messages as they arrive; ends when none has arrived for `timeout` seconds.

        Raises ConnectionClosed once it is closed.
        """
        deadline_after(timeout)  # a wrong one raises here, not at the first message
        self._foreground.check()
        return self._found(timeout, with_info=False)

    def receive(self, timeout: float | None = None) -> tuple[M, MessageInfo]:
        """Wait for the next message; returns it with its info.

        Raises TimeoutError after `timeout` seconds, ConnectionClosed once it is closed.
        """
        self._foreground.check()
        taken = next(self._found(timeout, with_info=True), None)
        if taken is None:
            raise TimeoutError(f"no message on '{self.topic_name}' within {timeout:g} s")
        return taken[0], self._core.info(taken)

    def take(self) -> tuple[M, MessageInfo] | None:
        """The oldest waiting message and its info, or None. Never blocks."""
        self._foreground.check()
        self._foreground.attend()
        return self._native.take()

    def wait_for_publishers(self, number: int = 1, timeout: float | None = None) -> None:
        """Wait until at least `number` publishers are matched.

        Raises TimeoutError after `timeout` seconds.
        """
        native = self._native
        self._foreground.run_or_tell(
            lambda: native.wait_for_publishers(number),
            timeout,
            lambda: f"{native.get_publisher_count()} of {number} publishers of '{self.topic_name}'",
        )

    def get_publisher_count(self) -> int:
        """Publishers matched now."""
        self._foreground.attend()
        return self._native.get_publisher_count()

    def statistics(self) -> SubscriptionStatistics:
        """Its totals."""
        return self._native.statistics()

    def close(self) -> None:
        """Leave the graph. Closing twice is allowed."""
        if self._core.refusal is None:
            self._foreground.run(self._native.close)

    # --- inside

    def _found(self, timeout: float | None, *, with_info: bool) -> Iterator[Any]:
        """The messages as they come, `with_info` as in `Taken`; ends when none has come for `timeout`
        seconds.

        If the loop has nothing to do, this waits in one native call without the loop, because each step of
        Python is slow right after a sleep.
        """
        foreground, loop, guard, arrival = self._foreground, self._loop, self._guard, self._arrival
        core, receiver = self._core, self._receiver
        look = sleep = None
        if core.qos.deadline is None:  # else the deadline must see each message
            look, sleep = receiver.quick_take(with_info=with_info), receiver.quick_wait(with_info=with_info)
        ahead, runs = receiver.waiting
        found: Any
        while True:
            deadline_ns = 0 if timeout is None else deadline_after(timeout)
            if sleep is not None and not ahead and not runs and core.refusal is None:
                found = loop.wait(sleep, deadline_ns)
                if found is not None:
                    yield found
                    continue
            foreground.attend_rarely()
            with guard:
                found = (not with_info and receiver.take_messages(1)) or receiver.take()
                while not found and core.refusal is None:
                    arrival.is_set = False
                    if found := loop.run(arrival, deadline_ns, look):
                        found = found[0] if with_info else found
                        break
                    if arrival.is_set:
                        found = receiver.take()
                    elif loop.is_interrupted or (deadline_ns and monotonic_ns() >= deadline_ns):
                        break
                if found:
                    receiver.note()
            if loop.is_interrupted:
                loop.check()
            if not found:
                break
            yield found if with_info else found[0]
        if core.refusal is not None:
            raise again(core.refusal)
