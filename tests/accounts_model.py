"""The fate of every message, computed one at a time with lists: `accounts_world` is compared with it.

In a process, messages wait for a subscription in two places: messages from the socket, which are taken first,
and messages in the rings. Each is bounded by its depth. While the process does not read, messages by socket
wait at busd, with the same bound. Knows nothing of sockets, rings or sequence numbers in transit.
"""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from bus.qos import Durability, History, QoSProfile, Reliability

AT_ONCE = 64


class Message(NamedTuple):
    """A message. `order` counts the messages of all publishers, `number` the messages of its publisher."""

    order: int
    publisher: int
    number: int
    is_stale: bool
    """Its lifespan is over before it is taken."""


class Waiting:
    """Holds `depth` messages (0: all), and, until it is empty, also a late joiner's history."""

    def __init__(self, depth: int) -> None:
        self.depth = depth
        self.history = 0
        self.messages: deque[Message] = deque()

    def put(self, messages: Iterable[Message], *, history: bool = False) -> None:
        before = len(self.messages)
        self.messages.extend(messages)
        if history:
            self.history += len(self.messages) - before

    def surplus(self) -> int:
        return max(0, len(self.messages) - self.depth - self.history) if self.depth else 0

    def pop(self) -> Message:
        oldest = self.messages.popleft()
        self.look()
        return oldest

    def look(self) -> None:
        if not self.messages:
            self.history = 0


@dataclass(eq=False)
class Publisher:
    id: int
    process: int
    qos: QoSProfile
    published: int = 0
    history: list[Message] = field(default_factory=list)

    @property
    def depth(self) -> int:
        return depth_of(self.qos)


@dataclass(eq=False)
class Subscription:
    """`routes` are the routes of its matches, by publisher."""

    id: int
    process: int
    qos: QoSProfile
    at_busd: Waiting = field(init=False)
    by_socket: Waiting = field(init=False)
    in_rings: Waiting = field(init=False)
    routes: dict[int, str] = field(default_factory=dict)
    expected: int = 0
    ahead: deque[Message] = field(default_factory=deque)
    """Messages that a keep-all subscription has taken out of the rings at once; nothing can replace them."""
    received: list[tuple[int, int]] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    unseen: dict[int, list[Message]] = field(default_factory=dict)
    """Messages that others got by a publisher's ring while this one was away; the next one shows them."""
    before: dict[int, int] = field(default_factory=dict)
    """Messages that others got by a publisher's ring before the match by socket, if none came since."""
    replaced_at_busd: list[Message] = field(default_factory=list)
    """Since its process stopped reading."""
    late: dict[int, list[Message]] = field(default_factory=dict)
    """Messages of each publisher, published to it, but not received while the connection of an end is away.
    """
    gone: list[Message] = field(default_factory=list)
    """The same, for publishers that have left meanwhile."""

    def __post_init__(self) -> None:
        for name in ("at_busd", "by_socket", "in_rings"):
            setattr(self, name, Waiting(depth_of(self.qos)))

    @property
    def queued(self) -> int:
        """The number of messages queued in its process."""
        return len(self.ahead) + len(self.by_socket.messages) + len(self.in_rings.messages)

    def take(self) -> Message | None:
        """Take the oldest message from the socket, or else from the rings; stale ones are dropped."""
        message = self._pop()
        if message is not None:
            self.received.append((message.publisher, message.number))
        return message

    def _pop(self) -> Message | None:
        if self.ahead:
            return self.ahead.popleft()
        for waiting in (self.by_socket, self.in_rings):
            while waiting.messages:
                message = waiting.pop()
                if not message.is_stale:
                    self.ahead.append(message)
                    if waiting is self.by_socket or waiting.depth or len(self.ahead) == AT_ONCE:
                        return self.ahead.popleft()
                else:
                    self.dropped["expired"] += 1
        return self.ahead.popleft() if self.ahead else None

    def trim(self, waiting: Waiting) -> None:
        while waiting.surplus():
            oldest = waiting.pop()
            self.dropped["replaced"] += 1
            if waiting is self.at_busd:
                self.replaced_at_busd.append(oldest)

    def arrive(self, messages: list[Message], route: str, *, is_blocked: bool, history: bool = False) -> None:
        """Add messages published to it."""
        self.expected += len(messages)
        if route == "shm":
            self.in_rings.put(messages, history=history)
            self.in_rings.messages = deque(sorted(self.in_rings.messages))  # the oldest of all rings first
            self.trim(self.in_rings)
        elif is_blocked:
            self.at_busd.put(messages, history=history)
            self.trim(self.at_busd)
        else:
            self.by_socket.put(messages, history=history)
            self.trim(self.by_socket)

    def unblock(self) -> None:
        """Its process reads again."""
        self.by_socket.put(self.at_busd.messages)
        self.at_busd = Waiting(self.at_busd.depth)
        self.replaced_at_busd.clear()
        self.trim(self.by_socket)

    def cut_off(self) -> None:
        """Its process does not read, and loses its connection: messages queued at busd do not arrive."""
        messages = [*self.at_busd.messages]
        if keeps_history(self.qos):  # then a history may bring messages that busd has dropped
            self.dropped["replaced"] -= len(self.replaced_at_busd)
            messages = self.replaced_at_busd + messages
        self.expected -= len(messages)
        for one in messages:
            is_there = one.publisher in self.routes
            (self.late.setdefault(one.publisher, []) if is_there else self.gone).append(one)
        self.at_busd, self.replaced_at_busd = Waiting(self.at_busd.depth), []

    def lose(self, messages: list[Message]) -> None:
        """Count messages published to it without a connection as lost."""
        self.expected += len(messages)
        self.dropped["disconnected"] += len(messages)

    def see(self, publisher: int) -> None:
        self.lose(self.unseen.pop(publisher, []))

    def take_over(self, received: list[tuple[int, int]], dropped: dict[str, int]) -> None:
        """Replace the expected results by the real ones."""
        assert sum(self.dropped.values()) <= sum(dropped.values())
        self.by_socket, self.in_rings = Waiting(self.by_socket.depth), Waiting(self.in_rings.depth)
        self.ahead.clear()
        self.received, self.dropped = list(received), Counter(dropped)

    def leave_rings(self) -> None:
        """A match changes to the socket: messages in all rings are queued behind messages from the socket."""
        self.dropped["expired"] += sum(one.is_stale for one in self.in_rings.messages)
        self.by_socket.put(one for one in self.in_rings.messages if not one.is_stale)
        self.in_rings = Waiting(self.in_rings.depth)
        self.trim(self.by_socket)


class Model:
    """`sharing` are processes that share memory; `blocked` processes do not read their socket."""

    def __init__(self) -> None:
        self.publishers: dict[int, Publisher] = {}
        self.subscriptions: dict[int, Subscription] = {}
        self.sharing: set[int] = set()
        self.blocked: set[int] = set()
        self._order = 0

    def do_match(self, publisher: Publisher, subscription: Subscription) -> bool:
        offered, requested = publisher.qos, subscription.qos
        return (
            offered.reliability == Reliability.RELIABLE or requested.reliability == Reliability.BEST_EFFORT
        ) and (
            offered.durability == Durability.TRANSIENT_LOCAL or requested.durability == Durability.VOLATILE
        )

    def matched(self, publisher: Publisher) -> list[Subscription]:
        return [one for one in self.subscriptions.values() if publisher.id in one.routes]

    def add_publisher(self, publisher: Publisher) -> None:
        self.publishers[publisher.id] = publisher
        for subscription in self.subscriptions.values():
            self._match(publisher, subscription)

    def add_subscription(self, subscription: Subscription) -> None:
        self.subscriptions[subscription.id] = subscription
        for publisher in self.publishers.values():
            if self._match(publisher, subscription):
                history, route = self._history(publisher, subscription), subscription.routes[publisher.id]
                subscription.arrive(history, route, is_blocked=False, history=True)

    def publish(self, publisher: Publisher, count: int) -> list[Message]:
        """Make messages; `arrive` is for their receivers."""
        messages = []
        for _ in range(count):
            self._order += 1
            publisher.published += 1
            is_stale = publisher.qos.lifespan_ns > 0
            messages.append(Message(self._order, publisher.id, publisher.published, is_stale))
        if keeps_history(publisher.qos):
            publisher.history = (publisher.history + messages)[-publisher.depth or None :]
        return messages

    def deliver(self, publisher: Publisher, messages: list[Message]) -> None:
        for one in self.matched(publisher):
            if messages:
                if one.process not in self.blocked:
                    one.see(publisher.id)
                one.before.pop(publisher.id, None)
            one.arrive(messages, one.routes[publisher.id], is_blocked=one.process in self.blocked)

    def unblock(self, process: int) -> None:
        self.blocked.discard(process)
        for one in self.subscriptions.values():
            if one.process == process:
                one.unblock()

    def reroute(self, publisher: Publisher, subscription: Subscription) -> None:
        """Change a match from shared memory to the socket, until one of the two reconnects."""
        subscription.leave_rings()
        subscription.routes[publisher.id] = "socket"

    def connect_anew(self, process: int) -> None:
        """The process has reconnected after a loss: routes are chosen again."""
        for subscription in self.subscriptions.values():
            for number in subscription.routes:
                publisher = self.publishers[number]
                if process in (subscription.process, publisher.process):
                    subscription.routes[number] = self._natural_route(publisher, subscription)

    def cut(self, away: set[int]) -> None:
        """The connections of these processes are lost."""
        for one in self.subscriptions.values():
            if one.process in away & self.blocked:
                one.cut_off()
        self.blocked -= away

    def deliver_around(self, publisher: Publisher, messages: list[Message], away: set[int]) -> None:
        """As `deliver`, while the connections of processes are `away`. Shared memory is not affected."""
        for one in self.matched(publisher):
            route = one.routes[publisher.id]
            if route == "shm" or not away & {publisher.process, one.process}:
                one.arrive(messages, route, is_blocked=one.process in self.blocked)
            else:
                one.late.setdefault(publisher.id, []).extend(messages)

    def come_around(self, publisher: Publisher, away: set[int]) -> None:
        """As `add_publisher`; subscriptions of `away` processes will be late joiners."""
        self.publishers[publisher.id] = publisher
        for one in self.subscriptions.values():
            if one.process not in away:
                self._match(publisher, one)

    def leave_around(self, publisher: Publisher, *, is_lost: bool = False) -> None:
        """As `remove`: its messages to subscriptions that are away will not arrive any more."""
        for one in self.matched(publisher):
            late = one.late.pop(publisher.id, [])
            if is_lost and publisher.process in self.sharing and not keeps_history(publisher.qos):
                one.unseen[-publisher.id] = late  # how many its ring had is unknown, unless busd saw it
            else:
                one.gone += late
        self.remove(publisher.id, is_lost=is_lost)

    def return_deaf(self, away: set[int]) -> None:
        """They were back, and are away again before they have received anything."""
        for one in self.subscriptions.values():
            if one.process in away:
                for number, history in self._meet(one).items():
                    one.late.setdefault(number, []).extend(history)

    def return_of(self, away: set[int]) -> list[int]:
        """The processes that were `away` are back.

        Matches by socket: if the ends were not away for the same time, the queue or history has some of the
        messages published meanwhile. Returns the subscriptions for which the result is unknown.
        """
        unknown = set[int]()
        for one in self.subscriptions.values():
            one.lose(one.gone)
            late, one.late, one.gone = one.late, {}, []
            histories = self._meet(one) if one.process in away else {}
            if len(late) + len(histories) > 1:
                unknown.add(one.id)
            for source, messages in late.items():
                publisher = self.publishers[source]
                is_lossless = publisher.qos.is_lossless and one.qos.is_lossless
                has_history = keeps_history(publisher.qos) and (keeps_history(one.qos) or is_lossless)
                is_there = publisher.process not in away
                if is_there and not has_history and publisher.process in self.sharing:
                    one.unseen.setdefault(source, []).extend(messages)
                elif one.id in unknown or {publisher.process, one.process} <= away:
                    one.expected += len(messages)
                    unknown.add(one.id)
                elif not is_there:  # its queue holds at most so many
                    self._return(one, source, messages, publisher.depth or len(messages), history=False)
                elif has_history:
                    depths = [depth for depth in (publisher.depth, depth_of(one.qos)) if depth]
                    self._return(one, source, messages, min(depths, default=len(messages)), history=True)
                else:
                    self._return(one, source, messages, 0, history=False)
            for messages in histories.values():
                one.arrive(messages, "socket", is_blocked=False, history=True)
        return sorted(unknown)

    def _meet(self, one: Subscription) -> dict[int, list[Message]]:
        """Match it with publishers that came while it was away; returns the history from each of them."""
        histories = {}
        for publisher in self.publishers.values():
            if (
                publisher.id not in one.routes
                and self._match(publisher, one)
                and (history := self._history(publisher, one))
            ):
                histories[publisher.id] = history
        return histories

    def remove(self, endpoint: int, *, is_lost: bool = False) -> None:
        """Remove an endpoint; its published messages can still be taken. `is_lost`: its process has died."""
        self.subscriptions.pop(endpoint, None)
        if self.publishers.pop(endpoint, None) is not None:
            for subscription in self.subscriptions.values():
                subscription.routes.pop(endpoint, None)
                if is_lost:
                    subscription.unseen.pop(endpoint, None)
                else:
                    subscription.see(endpoint)  # it reports how many there were
                subscription.before.pop(endpoint, None)

    def endpoints_of(self, *processes: int) -> list[int]:
        endpoints: list[Publisher | Subscription] = [*self.publishers.values(), *self.subscriptions.values()]
        return [one.id for one in endpoints if one.process in processes]

    def _history(self, publisher: Publisher, subscription: Subscription) -> list[Message]:
        """The messages for a late joiner."""
        if not keeps_history(subscription.qos):
            return []
        depths = [depth for depth in (publisher.depth, depth_of(subscription.qos)) if depth]
        return publisher.history[-min(depths) :] if depths else [*publisher.history]

    def _return(
        self, one: Subscription, source: int, messages: list[Message], kept: int, *, history: bool
    ) -> None:
        """Deliver the last `kept` messages of those published without a connection."""
        lost = max(0, len(messages) - kept)
        is_blocked = one.process in self.blocked
        if is_blocked:
            one.unseen.setdefault(source, []).extend(messages[:lost])
        else:
            one.lose(messages[:lost])
        one.arrive(messages[lost:], "socket", is_blocked=is_blocked, history=history)

    def _match(self, publisher: Publisher, subscription: Subscription) -> bool:
        if not self.do_match(publisher, subscription):
            return False
        route = self._natural_route(publisher, subscription)
        subscription.routes[publisher.id] = route
        if route == "socket" and publisher.process in self.sharing:
            subscription.before[publisher.id] = publisher.published
        return True

    def _natural_route(self, publisher: Publisher, subscription: Subscription) -> str:
        return "shm" if {publisher.process, subscription.process} <= self.sharing else "socket"


def keeps_history(qos: QoSProfile) -> bool:
    return qos.durability == Durability.TRANSIENT_LOCAL


def depth_of(qos: QoSProfile) -> int:
    return qos.depth if qos.history == History.KEEP_LAST else 0
