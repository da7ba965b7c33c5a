"""The way out of one publisher through zenoh, with what is kept for importers."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence

from bus.qos import Durability, Reliability
from bus.qos import History as Kept
from bus.vocabulary import DropReason
from bus_bridge.engine import LocalEndpoint, RouteRule, Sample
from bus_bridge.packed import Packed
from bus_bridge.zenoh import keys, records
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.records import Part
from bus_bridge.zenoh.session import Outlet, Query, Session
from bus_bridge.zenoh.window import History, Window

__all__ = ["ZenohWriter"]

_DEPTH = 1000
_LEAVE_S = 2.0
_NUDGE_S = 0.02


class ZenohWriter:
    """The way out of one publisher of this bus."""

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
        self._endpoint = endpoint
        self._session = session
        self._key = keys.data_key(endpoint.topic, endpoint.type_name, endpoint.type_hash, bus, endpoint.gid)
        self._priority = rule.priority
        self._on_change = on_change
        self._on_close = on_close
        self._is_reliable = qos.reliability is Reliability.RELIABLE
        self._history: History | None = None
        if qos.durability is Durability.TRANSIENT_LOCAL:
            self._history = History((rule.depth or _DEPTH) if qos.history is Kept.KEEP_ALL else qos.depth)
        self._window = Window(lossless=qos.is_lossless)
        self._number = 0
        self._rest: deque[Part] = deque()
        """Parts of messages that have been written, for which there was no room yet."""
        self._interests: frozenset[Interest] = frozenset()
        self._outlet: Outlet | None = None
        self._lost: dict[str, int] = {}
        self._is_held = False
        self._in_flight_before = 0
        self._is_leaving = False
        self._is_closed = False
        self._waiting: set[str] = set()
        """While leaving: who has not said yet that it has got everything."""
        self._patience: asyncio.TimerHandle | None = None
        self._nudging: asyncio.TimerHandle | None = None

    @property
    def is_wanted(self) -> bool:
        if self._history is not None:
            return True  # late joiners want what it keeps
        return bool(self._interests) and self._outlet is not None and self._outlet.is_ready

    @property
    def lost(self) -> dict[str, int]:
        return self._lost

    def write(self, samples: Sequence[Sample]) -> int:
        """As `Writer.write`. What a best effort publisher sends beyond the link's speed is lost here."""
        count = gone = len(samples)
        if self._interests:
            gone = self._fitting(samples, count)
            if gone < count:
                if self._is_reliable:
                    self._is_held = True
                    self._nudge_later(_NUDGE_S)
                else:
                    self._lost[DropReason.LINK_FULL] = self._lost.get(DropReason.LINK_FULL, 0) + count - gone
            fitting = samples if gone == count else samples[:gone]
            self._rest += records.pack(fitting, self._number + 1, self._window.part_bytes)
            if self._rest:
                self._number = self._rest[-1].number
            self._pump()
            if not self._is_reliable:
                gone = count
        if self._history is not None:
            self._history.add(samples[:gone])
        return gone

    def close(self) -> None:
        """As `Writer.close`. Its token stays until the importers have got what was written."""
        if self._is_leaving or self._is_closed:
            return
        self._is_leaving = True
        if not self._interests or not self._number:
            self.end()
            return
        self._waiting = {one.run for one in self._interests}
        self._probe()
        self._wait()

    # --- for the engine

    def come_back(self, endpoint: LocalEndpoint, on_change: Callable[[], None]) -> bool:
        """The publisher is there again before all has arrived that it said when it went. Returns whether it
        is as it was: then importers go on, who would not see that a token went and came at once."""
        if endpoint != self._endpoint:
            return False
        self._is_leaving = False
        self._waiting.clear()
        if self._patience is not None:
            self._patience.cancel()
        self._on_change = on_change
        self._lost = {}
        return True

    def end(self) -> None:
        """Gone, whatever has arrived."""
        if self._is_closed:
            return
        self._is_closed = True
        for timer in (self._patience, self._nudging):
            if timer is not None:
                timer.cancel()
        if self._outlet is not None:
            self._outlet.undeclare()
            self._outlet = None
        self._on_close()

    def see_interests(self, interests: frozenset[Interest]) -> None:
        """Who takes what it sends has changed."""
        for one in interests - self._interests:
            self._window.join(one.run)
        for one in self._interests - interests:
            self._window.leave(one.run)
        was_wanted, self._interests = self.is_wanted, interests
        if not interests:
            self._rest.clear()
            self._number = self._window.last
        elif self._outlet is None and not self._is_closed:
            self._outlet = self._session.outlet(self._key, self._priority, self._begin)
        self._waiting &= {one.run for one in interests}
        self._go_on()
        if self._is_leaving:
            self._end_if_arrived()
        elif self.is_wanted != was_wanted:
            self._on_change()

    def see_ack(self, importer: str, arrived: int, taken: int) -> None:
        """How far an importer is."""
        is_news = self._window.hear(importer, arrived, taken)
        if is_news:
            self._go_on()
        if self._is_leaving:
            if is_news:
                self._wait()
            if not self._rest and arrived >= self._number:
                self._waiting.discard(importer)
            elif not self._rest:
                self._probe()
            self._end_if_arrived()

    def reply(self, query: Query, importer: str) -> None:
        """Somebody lacks a part, or does not know yet where the route begins and what is kept."""
        base, asked = self._window.joined(importer), records.read_pair(query.payload[1:])
        if base is None or asked is None:
            query.drop()
        elif query.payload[:1] == b"p":
            part = self._window.find(importer, asked[0]) or records.probe(self._window.last)
            query.reply(part.payload, part.head)
        else:
            kept = None if self._history is None else self._history.find(*asked)
            begin = records.write_pair(base, 0)
            query.reply(*((b"", begin) if kept is None else (kept.payload, begin + kept.head)))

    def look(self) -> None:
        """About once a second: where nothing arrives any more, what was sent last may have been lost."""
        in_flight, before = self._window.in_flight, self._in_flight_before
        self._in_flight_before = in_flight
        if in_flight and in_flight >= before:
            self._probe()

    # --- inside

    def _fitting(self, samples: Sequence[Sample], count: int) -> int:
        """How many of these `count` may be written now."""
        room = 0 if self._rest else self._window.room
        if type(samples) is Packed:  # mostly one part
            return count if room > 0 else 0
        for index, sample in enumerate(samples):
            if room <= 0:
                return index
            room -= len(sample[0])
        return count

    def _pump(self) -> None:
        """Put what waits for room, as far as there is some."""
        outlet, window, rest = self._outlet, self._window, self._rest
        if not rest or outlet is None or not outlet.is_ready:
            return
        put = outlet.put
        while rest and window.room > 0:
            part = rest.popleft()
            try:
                put(part.payload, attachment=part.head)
            finally:  # behind it: meanwhile zenoh's threads have begun
                window.add(part)
        if window.must_ask():
            self._probe()
        if rest:
            self._nudge_later(_NUDGE_S)

    def _nudge_later(self, delay_s: float) -> None:
        if self._nudging is None:
            before = self._window.in_flight
            self._nudging = asyncio.get_running_loop().call_later(delay_s, self._nudge, before, delay_s)

    def _nudge(self, before: int, delay_s: float) -> None:
        """Something waits for room: where nothing moves, a question or its answer was dropped."""
        self._nudging = None
        if not self._is_closed and (self._rest or self._is_held):
            has_moved = self._window.in_flight != before
            if not has_moved:
                self._probe()
            self._nudge_later(_NUDGE_S if has_moved else min(2 * delay_s, 1.0))

    def _go_on(self) -> None:
        """There may be room again: for what waits here, then for the caller."""
        self._pump()
        if self._is_held and not self._rest and self._window.room > 0:
            self._is_held = False
            self._on_change()

    def _begin(self) -> None:
        self._pump()
        self._on_change()

    def _probe(self) -> None:
        if self._outlet is not None and self._outlet.is_ready:
            part = records.probe(self._window.last)
            self._outlet.put(part.payload, attachment=part.head)

    def _wait(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
        self._patience = asyncio.get_running_loop().call_later(_LEAVE_S, self.end)

    def _end_if_arrived(self) -> None:
        if not self._waiting:
            self.end()
