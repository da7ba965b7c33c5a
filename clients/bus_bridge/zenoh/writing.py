"""The route out of one publisher through zenoh, with the parts kept for importers."""

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum

from bus.qos import Durability, Reliability
from bus.qos import History as Kept
from bus.vocabulary import DropReason
from bus_bridge.batch import Batch, Loose
from bus_bridge.engine import LocalEndpoint, RouteRule
from bus_bridge.packed import Packed
from bus_bridge.zenoh import keys, records
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.probing import Probing
from bus_bridge.zenoh.records import PART_BYTES, Part
from bus_bridge.zenoh.session import Outlet, Query, Session
from bus_bridge.zenoh.window import History, Window

__all__ = ["TRANSITIONS", "WriterError", "WriterEvent", "WriterState", "ZenohWriter"]

_DEPTH = 1000
_LEAVE_S = 2.0


class WriterState(Enum):
    """Whether the publisher exists."""

    OPEN = "open"
    LEAVING = "leaving"
    """The publisher has gone, but importers still receive its messages. Its token stays until then."""
    CLOSED = "closed"


class WriterEvent(Enum):
    """Events that change the state."""

    LEAVE = "leave"
    """The publisher has gone."""
    RETURN = "return"
    """The publisher is back."""
    END = "end"
    """All importers have all messages, or have taken too long; or the engine closes."""


TRANSITIONS: Mapping[WriterState, Mapping[WriterEvent, WriterState]] = {
    WriterState.OPEN: {WriterEvent.LEAVE: WriterState.LEAVING, WriterEvent.END: WriterState.CLOSED},
    WriterState.LEAVING: {WriterEvent.RETURN: WriterState.OPEN, WriterEvent.END: WriterState.CLOSED},
    WriterState.CLOSED: {},
}
"""The next state, by state and event. An event that is missing in the row of a state must not happen in
it."""


class WriterError(Exception):
    """An event that is not possible in the current state: a bug in the bridge."""


class _Leave:
    """The state LEAVING. Calls `end` if importers take too long."""

    __slots__ = ("_end", "_patience", "behind")

    def __init__(self, end: Callable[[], None]) -> None:
        self.behind: set[str] = set()
        """Importers that don't have all messages yet."""
        self._end = end
        self._patience: asyncio.TimerHandle | None = None

    def wait(self) -> None:
        """Begin to wait for the importers' progress, from now on."""
        if self._patience is not None:
            self._patience.cancel()
        self._patience = asyncio.get_running_loop().call_later(_LEAVE_S, self._end)

    def cancel(self) -> None:
        """Wait no longer, for no importer."""
        self.behind.clear()
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None


class ZenohWriter:
    """The route out of one publisher of this bus. Only `on` changes the state."""

    def __init__(
        self,
        session: Session,
        bus: str,
        endpoint: LocalEndpoint,
        rule: RouteRule,
        on_change: Callable[[], None],
        on_close: Callable[[], None],
    ) -> None:
        qos = endpoint.qos
        self._key = keys.data_key(endpoint.topic, endpoint.type_name, endpoint.type_hash, bus, endpoint.gid)
        self.state = WriterState.OPEN
        self._endpoint = endpoint
        self._rule = rule
        self._session = session
        self._on_change = on_change
        self._on_close = on_close
        self._history: History | None = None
        if qos.durability is Durability.TRANSIENT_LOCAL:
            self._history = History(self._history_depth(rule))
        self._kept_until: dict[str, int] = {}
        """Number of the newest kept message when each importer joined. It gets later ones as parts: otherwise
        it might never reach the end of a fast publisher's kept messages."""
        self._window = Window(lossless=qos.is_lossless)
        self._probing = Probing(self._window, self._probe, self._is_stuck)
        self._number = 0
        self._rest: deque[Part] = deque()
        """Parts of written messages that wait for room."""
        self._is_held = False
        """Whether the caller keeps further messages, because there was no room for them."""
        self._importers: frozenset[str] = frozenset()
        """Runs of the bridges that take its messages. Two buses with the same run (one of them is
        a stranger) are one importer."""
        self._outlet: Outlet | None = None
        self._lost: dict[str, int] = {}
        self._leave = _Leave(self.end)

    @property
    def is_wanted(self) -> bool:
        if self._history is not None:
            return True  # late joiners need the kept messages
        return bool(self._importers) and self._outlet is not None and self._outlet.put is not None

    @property
    def lost(self) -> dict[str, int]:
        return self._lost

    def write(self, batch: Batch) -> int:
        """As `Writer.write`. Drops messages of a best-effort publisher that are too fast for the link."""
        count = gone = batch.count
        if self._importers:
            if batch.__class__ is Packed:  # the usual case: one part
                gone = 0 if self._rest or self._window.room <= 0 else count
            else:
                gone = self._fitting(batch)
            if gone:
                fitting = batch if gone == count else Loose(list(batch)[:gone])
                # The window never limits parts of this size.
                most = self._window.part_bytes if batch.payload_bytes > PART_BYTES else 2 * PART_BYTES
                self._rest += records.pack(fitting, self._number + 1, most)
                self._number = self._rest[-1].number
            if gone < count:
                self._refuse(count - gone)
                gone = gone if self._is_reliable else count
            self._pump()
        if self._history is not None:
            self._history.add(batch if gone == count else list(batch)[:gone])
        return gone

    def close(self) -> None:
        """As `Writer.close`. Its token stays until the importers have received all written messages."""
        if self.state is not WriterState.OPEN:
            return
        self.on(WriterEvent.LEAVE)
        if not self._importers or not self._number:
            self.end()
            return
        self._leave.behind = set(self._importers)
        self._probe()
        self._leave.wait()

    # --- for the engine

    def on(self, event: WriterEvent) -> None:
        """Handle `event`. Raises WriterError if it is not possible in this state."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            way = f"the way out of a publisher on '{self._endpoint.topic}'"
            raise WriterError(f"{way} is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state

    def come_back(self, endpoint: LocalEndpoint, rule: RouteRule, on_change: Callable[[], None]) -> bool:
        """Continue for a publisher that is back before its last messages have arrived. Returns whether it is
        unchanged.

        If so, importers go on: they would not notice a token that goes and comes back at once. The same is
        true if a reload has brought another `rule`.
        """
        if endpoint != self._endpoint:
            return False
        self.on(WriterEvent.RETURN)
        self._leave.cancel()
        self._on_change = on_change
        self._follow(rule)
        self._lost = {}
        return True

    def end(self) -> None:
        """End at once, whether messages have arrived or not."""
        if self.state is WriterState.CLOSED:
            return
        self.on(WriterEvent.END)
        self._probing.close()
        self._leave.cancel()
        if self._outlet is not None:
            self._outlet.undeclare()
            self._outlet = None
        self._on_close()

    def see_interests(self, interests: frozenset[Interest]) -> None:
        """Handle a change of the buses that take its messages."""
        importers = frozenset(one.run for one in interests)
        for one in importers - self._importers:
            self._window.join(one)
            if self._history is not None:
                self._kept_until[one] = self._history.last
        for one in self._importers - importers:
            self._window.leave(one)
            self._kept_until.pop(one, None)
        was_wanted, self._importers = self.is_wanted, importers
        if not importers:
            self._rest.clear()
            self._number = self._window.last
        elif self._outlet is None and self.state is not WriterState.CLOSED:
            self._make_outlet()
        self._leave.behind &= importers
        self._go_on()
        if self.state is WriterState.LEAVING:
            self._end_if_arrived()
        elif self.is_wanted != was_wanted:
            self._on_change()

    def see_ack(self, importer: str, arrived: int, taken: int) -> None:
        """Handle an importer's ack."""
        is_news = self._window.acknowledge(importer, arrived, taken)
        if is_news:
            self._go_on()
        if self.state is WriterState.LEAVING:
            if is_news:
                self._leave.wait()
            if not self._rest and arrived >= self._number:
                self._leave.behind.discard(importer)
            elif not self._rest:
                self._probe()
            self._end_if_arrived()

    def reply(self, query: Query, importer: str) -> None:
        """Answer an importer that misses a part, or asks for the first part of the route and the kept
        parts."""
        base, asked = self._window.joined(importer), records.read_pair(query.payload[1:])
        if base is None or asked is None:
            query.drop()
        elif query.payload[:1] == b"p":
            part = self._window.find(importer, asked[0]) or records.probe(self._window.last)
            query.reply(part.payload, part.head)
        else:
            history, last = self._history, self._kept_until.get(importer, 0)
            kept = None if history is None else history.find(*asked, last)
            begin = records.write_pair(base, 0)
            query.reply(*((b"", begin) if kept is None else (kept.payload, begin + kept.head)))

    def poll(self) -> None:
        """Check the progress of importers. Call this about once a second."""
        self._probing.scan()

    # --- internal

    @property
    def _is_reliable(self) -> bool:
        return self._endpoint.qos.reliability is Reliability.RELIABLE

    def _make_outlet(self) -> None:
        self._outlet = self._session.outlet(self._key, self._rule.priority, self._begin)

    def _history_depth(self, rule: RouteRule) -> int:
        qos = self._endpoint.qos
        return (rule.depth or _DEPTH) if qos.history is Kept.KEEP_ALL else qos.depth

    def _follow(self, rule: RouteRule) -> None:
        before, self._rule = self._rule, rule
        if self._history is not None:
            self._history.limit(self._history_depth(rule))
        if self._outlet is not None and rule.priority != before.priority:
            self._outlet.undeclare()
            self._make_outlet()

    def _fitting(self, batch: Batch) -> int:
        """The number of these messages that may be written now."""
        room = 0 if self._rest else self._window.room
        for index, sample in enumerate(batch):
            if room <= 0:
                return index
            room -= len(sample[0])
        return batch.count

    def _refuse(self, count: int) -> None:
        """Handle `count` messages without room."""
        if self._is_reliable:
            self._is_held = True
            self._probing.begin()
        else:
            self._lost[DropReason.LINK_FULL] = self._lost.get(DropReason.LINK_FULL, 0) + count

    def _pump(self) -> None:
        """Put waiting parts while there is room."""
        outlet, window, rest = self._outlet, self._window, self._rest
        if not rest or outlet is None or outlet.put is None:
            return
        put, must_ask = outlet.put, False
        while rest and window.room > 0:
            part = rest.popleft()
            try:
                put(part.payload, attachment=part.head)
            finally:  # after the put: zenoh sends meanwhile
                must_ask = window.add(part) or must_ask
        if must_ask:
            self._probe()
        if rest:
            self._probing.begin()

    def _is_stuck(self) -> bool:
        return self.state is not WriterState.CLOSED and (bool(self._rest) or self._is_held)

    def _go_on(self) -> None:
        """Continue because there may be room again: first for waiting parts, then for the caller."""
        self._pump()
        if self._is_held and not self._rest and self._window.room > 0:
            self._is_held = False
            self._on_change()

    def _begin(self) -> None:
        self._pump()
        self._on_change()

    def _probe(self) -> None:
        if self._outlet is not None and self._outlet.put is not None:
            part = records.probe(self._window.last)
            self._outlet.put(part.payload, attachment=part.head)

    def _end_if_arrived(self) -> None:
        if not self._leave.behind:
            self.end()
