"""What becomes of every message, done one at a time with lists: `accounts_world` is compared with it.

A subscription has two places where messages wait for it in its process: what came by socket, which is taken
first, and what is in the rings. Each is bounded by its depth. While its process does not read, what goes by
socket waits at busd, bounded in the same way. Knows nothing of sockets, rings or sequence numbers on the way.
"""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from bus.qos import Durability, History, QoSProfile, Reliability

AT_ONCE = 64


class Message(NamedTuple):
    """`order` is that of all messages of all publishers; `number` that of its publisher's."""

    order: int
    publisher: int
    number: int
    is_stale: bool
    """It has outlived its lifespan by the time that anybody looks."""


class Waiting:
    """Holds `depth` messages (0: all), and besides, until it is empty, the history that a late joiner got."""

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
    """`routes` are those of its matches, by publisher."""

    id: int
    process: int
    qos: QoSProfile
    at_busd: Waiting = field(init=False)
    by_socket: Waiting = field(init=False)
    in_rings: Waiting = field(init=False)
    routes: dict[int, str] = field(default_factory=dict)
    expected: int = 0
    ahead: deque[Message] = field(default_factory=deque)
    """Keeping all, it takes so many out of the rings at once; nothing can replace them any more."""
    received: list[tuple[int, int]] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    unseen: dict[int, list[Message]] = field(default_factory=dict)
    """By publisher, what went to others by its ring while this one was away: its next message shows that."""
    before: dict[int, int] = field(default_factory=dict)
    """By publisher, what went to others by its ring before the match by socket, if nothing came since."""
    replaced_at_busd: list[Message] = field(default_factory=list)
    """Since its process does not read."""
    late: dict[int, list[Message]] = field(default_factory=dict)
    """By publisher, what was published to it and has not come, while the connection of an end is away."""
    gone: list[Message] = field(default_factory=list)
    """The same, of publishers that have left meanwhile."""

    def __post_init__(self) -> None:
        for name in ("at_busd", "by_socket", "in_rings"):
            setattr(self, name, Waiting(depth_of(self.qos)))

    @property
    def queued(self) -> int:
        """In its process."""
        return len(self.ahead) + len(self.by_socket.messages) + len(self.in_rings.messages)

    def take(self) -> Message | None:
        """The oldest of what came by socket, else of what is in the rings; what is stale goes by the way."""
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
        """They were published to it."""
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
        """Its process does not read, and loses its connection: what waits at busd does not come."""
        messages = [*self.at_busd.messages]
        if keeps_history(self.qos):  # then what busd has dropped may come again, out of a history
            self.dropped["replaced"] -= len(self.replaced_at_busd)
            messages = self.replaced_at_busd + messages
        self.expected -= len(messages)
        for one in messages:
            is_there = one.publisher in self.routes
            (self.late.setdefault(one.publisher, []) if is_there else self.gone).append(one)
        self.at_busd, self.replaced_at_busd = Waiting(self.at_busd.depth), []

    def lose(self, messages: list[Message]) -> None:
        """They were published to it while there was no way."""
        self.expected += len(messages)
        self.dropped["disconnected"] += len(messages)

    def see(self, publisher: int) -> None:
        self.lose(self.unseen.pop(publisher, []))

    def take_over(self, received: list[tuple[int, int]], dropped: dict[str, int]) -> None:
        """What became of the messages, in place of what was thought."""
        assert sum(self.dropped.values()) <= sum(dropped.values())
        self.by_socket, self.in_rings = Waiting(self.by_socket.depth), Waiting(self.in_rings.depth)
        self.ahead.clear()
        self.received, self.dropped = list(received), Counter(dropped)

    def leave_rings(self) -> None:
        """A match goes by socket now: what waits in all the rings is put behind what came by socket."""
        self.dropped["expired"] += sum(one.is_stale for one in self.in_rings.messages)
        self.by_socket.put(one for one in self.in_rings.messages if not one.is_stale)
        self.in_rings = Waiting(self.in_rings.depth)
        self.trim(self.by_socket)


class Model:
    """`sharing` are the processes that share memory, `blocked` those that do not read their socket."""

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
        """Make messages; `arrive` is for whoever gets them."""
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
        """From shared memory to the socket, as it stays until one of the two connects anew."""
        subscription.leave_rings()
        subscription.routes[publisher.id] = "socket"

    def connect_anew(self, process: int) -> None:
        """The process has lost its connection and has another: routes are chosen again."""
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
        """As `deliver`, while the connections of processes are `away`. By shared memory nobody notices."""
        for one in self.matched(publisher):
            route = one.routes[publisher.id]
            if route == "shm" or not away & {publisher.process, one.process}:
                one.arrive(messages, route, is_blocked=one.process in self.blocked)
            else:
                one.late.setdefault(publisher.id, []).extend(messages)

    def come_around(self, publisher: Publisher, away: set[int]) -> None:
        """As `add_publisher`; to it the subscriptions of those that are `away` will be late joiners."""
        self.publishers[publisher.id] = publisher
        for one in self.subscriptions.values():
            if one.process not in away:
                self._match(publisher, one)

    def leave_around(self, publisher: Publisher, *, is_lost: bool = False) -> None:
        """As `remove`: what it published to subscriptions that are away will not come any more."""
        for one in self.matched(publisher):
            late = one.late.pop(publisher.id, [])
            if is_lost and publisher.process in self.sharing and not keeps_history(publisher.qos):
                one.unseen[-publisher.id] = late  # nobody knows how much went by its ring, unless busd saw it
            else:
                one.gone += late
        self.remove(publisher.id, is_lost=is_lost)

    def return_deaf(self, away: set[int]) -> None:
        """They were back, and are away again before they have heard anything."""
        for one in self.subscriptions.values():
            if one.process in away:
                for number, history in self._meet(one).items():
                    one.late.setdefault(number, []).extend(history)

    def return_of(self, away: set[int]) -> list[int]:
        """The processes that were `away` are back.

        By socket, the queue or history has some of what was published meanwhile, where both ends are not the
        same time away. Returns the subscriptions of which that is not known.
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
                elif not is_there:  # its queue holds so many
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
        """Match it with the publishers that came while it was away; returns what history it gets of them."""
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
        """What it has published is still there to be taken. `is_lost`: its process has died."""
        self.subscriptions.pop(endpoint, None)
        if self.publishers.pop(endpoint, None) is not None:
            for subscription in self.subscriptions.values():
                subscription.routes.pop(endpoint, None)
                if is_lost:
                    subscription.unseen.pop(endpoint, None)
                else:
                    subscription.see(endpoint)  # it says how many there were
                subscription.before.pop(endpoint, None)

    def endpoints_of(self, *processes: int) -> list[int]:
        endpoints: list[Publisher | Subscription] = [*self.publishers.values(), *self.subscriptions.values()]
        return [one.id for one in endpoints if one.process in processes]

    def _history(self, publisher: Publisher, subscription: Subscription) -> list[Message]:
        """What a late joiner gets."""
        if not keeps_history(subscription.qos):
            return []
        depths = [depth for depth in (publisher.depth, depth_of(subscription.qos)) if depth]
        return publisher.history[-min(depths) :] if depths else [*publisher.history]

    def _return(
        self, one: Subscription, source: int, messages: list[Message], kept: int, *, history: bool
    ) -> None:
        """The last `kept` of what was published while there was no way come now."""
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
