"""The ways of single publishers through zenoh: out, with what is kept for importers, and in, in order."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence

from bus.qos import Durability, History, Reliability
from bus_bridge.engine import FarEndpoint, LocalEndpoint, RouteRule, Sample
from bus_bridge.zenoh import keys, records
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.session import Outlet, Query, Session
from bus_bridge.zenoh.window import Kept

__all__ = ["ZenohReader", "ZenohWriter"]

_DEPTH = 1000
_READER_BYTES = 16 << 20
_ASK_S = 1.0
_SAY_BYTES = 256 << 10
_SAY_S = 0.01
_LEAVE_S = 2.0


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
        self.gid = endpoint.gid
        self._session = session
        self._key = keys.data_key(endpoint.topic, endpoint.type_name, endpoint.type_hash, bus, endpoint.gid)
        self._priority = rule.priority
        self._on_change = on_change
        self._on_close = on_close
        self._is_latched = qos.durability is Durability.TRANSIENT_LOCAL
        depth = (rule.depth or _DEPTH) if qos.history is History.KEEP_ALL else qos.depth
        self._is_reliable = qos.reliability is Reliability.RELIABLE
        self._kept: Kept | None = None
        if self._is_reliable or self._is_latched:
            self._kept = Kept(
                reliable=self._is_reliable,
                lossless=qos.is_lossless,
                history=depth if self._is_latched else 0,
            )
        self._interests: frozenset[Interest] = frozenset()
        self._outlet: Outlet | None = None
        self._is_held = False
        self._in_flight_before = 0
        self._last = 0
        self._is_leaving = False
        self._is_closed = False
        self._waiting: set[str] = set()
        """While leaving: who has not said yet that it has got everything."""
        self._patience: asyncio.TimerHandle | None = None

    @property
    def lost(self) -> dict[str, int]:
        """As `Writer.lost`: zenoh does not say what it drops; the far side sees it by the numbers."""
        return {}

    @property
    def is_wanted(self) -> bool:
        if self._is_latched:
            return True  # late joiners want what it keeps
        return bool(self._interests) and self._outlet is not None and self._outlet.is_ready

    @property
    def lost(self) -> dict[str, int]:
        """None: what zenoh drops is sent again, or missing on arrival."""
        return {}

    def write(self, samples: Sequence[Sample]) -> int:
        kept = self._kept
        previous: int | None = None
        if kept is not None:
            fitting = kept.fitting(samples)
            if fitting < len(samples):
                self._is_held = True
                samples = samples[:fitting]
            if self._is_reliable:
                previous = kept.last
            kept.add(samples)
        if self._interests and self._outlet is not None and self._outlet.is_ready:
            put = self._outlet.put
            for payload, attachment in records.pack(samples, previous):
                put(payload, attachment=attachment)
            if samples:
                self._last = samples[-1].number
            if kept is not None and kept.must_ask():
                self._probe()
        return len(samples)

    def close(self) -> None:
        """As `Writer.close`. Its token stays until the importers have got what was written."""
        if self._is_leaving or self._is_closed:
            return
        self._is_leaving = True
        if self._outlet is None or not self._outlet.is_ready or not self._interests or not self._last:
            self.end()
            return
        self._waiting = {one.run for one in self._interests}
        self._probe()
        self._patience = asyncio.get_running_loop().call_later(_LEAVE_S, self.end)

    # --- for the engine

    def end(self) -> None:
        """Gone, whatever has arrived."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._patience is not None:
            self._patience.cancel()
        if self._outlet is not None:
            self._outlet.undeclare()
            self._outlet = None
        self._on_close()

    def see_interests(self, interests: frozenset[Interest]) -> None:
        """Who takes what it sends has changed."""
        if self._kept is not None:
            for one in interests - self._interests:
                self._kept.join(one.run)
            for one in self._interests - interests:
                self._kept.leave(one.run)
        was_wanted, self._interests = self.is_wanted, interests
        if self._is_leaving:
            self._waiting &= {one.run for one in interests}
            self._end_if_arrived()
            return
        if interests and self._outlet is None:
            self._outlet = self._session.outlet(self._key, self._priority, self._on_change)
        if self.is_wanted != was_wanted or self._is_held:
            self._go_on()

    def see_word(self, importer: str, arrived: int, taken: int) -> None:
        """How far an importer is."""
        if self._kept is not None and self._kept.hear(importer, arrived, taken) and self._is_held:
            self._go_on()
        if self._is_leaving and arrived >= self._last:
            self._waiting.discard(importer)
            self._end_if_arrived()

    def _end_if_arrived(self) -> None:
        if not self._waiting:
            self.end()

    def reply(self, query: Query, importer: str, after: int) -> None:
        """Somebody lacks what came after the number `after`."""
        found = None if self._kept is None else self._kept.find(importer, after)
        if found is None:
            query.drop()
            return
        assert self._kept is not None
        payload, alone = next(records.pack(found, None, records.BATCH_BYTES), (b"", None))
        query.reply(payload, (alone or b"") + records.write_number(self._kept.last))

    def look(self) -> None:
        """About once a second: where nothing is taken any more, what was sent last may have been lost."""
        if self._kept is None:
            return
        in_flight, before = self._kept.in_flight, self._in_flight_before
        self._in_flight_before = in_flight
        if in_flight and in_flight >= before:
            self._probe()

    def _probe(self) -> None:
        if self._outlet is not None and self._outlet.is_ready:
            payload, attachment = records.probe(self._last)
            self._outlet.put(payload, attachment=attachment)

    def _go_on(self) -> None:
        self._is_held = False
        self._on_change()


class ZenohReader:
    """The way in from one far publisher."""

    def __init__(
        self,
        session: Session,
        own: str,
        run: str,
        bus: str,
        endpoint: FarEndpoint,
        on_samples: Callable[[Sequence[Sample]], None],
        on_broken: Callable[[str], None],
        on_close: Callable[[], None],
    ) -> None:
        gid, qos = endpoint.gid, endpoint.qos
        self._session = session
        self._topic = endpoint.topic
        self._on_samples = on_samples
        self._on_broken = on_broken
        self._on_close = on_close
        self._is_lossless = qos.is_lossless
        self._is_reliable = qos.reliability is Reliability.RELIABLE
        asks = self._is_reliable or qos.durability is Durability.TRANSIENT_LOCAL
        self._arrival = Arrival(reliable=self._is_reliable, asks=asks)
        self._arrived: list[Sample] = []
        self._is_asking = False
        self._is_closed = False
        self._lost: dict[str, int] = {}
        self._untaken: deque[tuple[int, int]] = deque()
        """Number and size of what has gone on, until the bus has taken it."""
        self._credit = 0
        self._taken = 0
        self._unsaid = 0
        self._is_asked = False
        self._saying: asyncio.TimerHandle | None = None
        self._kept_key = keys.kept_key(bus, gid, run)
        self._word_key = keys.word_key(bus, gid, run)
        self._source = session.source(
            self._take, _READER_BYTES, self._lose, keeps_oldest=self._is_reliable, after=self._give
        )
        push = self._source.push
        key = keys.data_key(endpoint.topic, endpoint.type_name, endpoint.type_hash, bus, gid)
        # The token last: who sees it may begin to send.
        self._subscriber = session.subscribe(
            key,
            lambda _, payload, attachment: push((payload, attachment), len(payload)),
        )
        self._token = session.token(keys.interest_token(own, run, bus, gid))
        if asks:
            self._ask()

    @property
    def lost(self) -> dict[str, int]:
        dropped = self._arrival.dropped
        return (
            {**self._lost, "bridge_full": self._lost.get("bridge_full", 0) + dropped}
            if dropped
            else self._lost
        )

    def taken(self, size: int) -> None:
        if not self._is_lossless:
            return
        self._credit += size
        while self._untaken and self._untaken[0][1] <= self._credit:
            self._taken, gone = self._untaken.popleft()
            self._credit -= gone
        self._unsaid += size
        if self._unsaid >= _SAY_BYTES:
            self._say()
        elif self._saying is None:
            self._saying = asyncio.get_running_loop().call_later(_SAY_S, self._say)

    def close(self) -> None:
        if self._is_closed:
            return
        self._is_closed = True
        if self._saying is not None:
            self._saying.cancel()
        self._token.undeclare()
        self._subscriber.undeclare()
        self._source.close()
        self._on_close()

    def _lose(self, put: tuple[bytes, bytes | None]) -> None:  # in zenoh's thread
        if not self._is_reliable:  # those are asked for
            lost = records.count(*put, marked=False)
            self._lost["bridge_full"] = self._lost.get("bridge_full", 0) + lost

    def _take(self, put: tuple[bytes, bytes | None]) -> None:
        payload, attachment = put
        is_probe = records.is_probe(payload, attachment)
        found = records.unpack(payload, attachment, marked=self._is_reliable or is_probe)
        if found is None:
            self._on_broken(f"a message on {self._topic} can't be read")
            return
        samples, previous = found
        self._arrived += self._arrival.arrive(samples, previous)
        self._is_asked |= is_probe

    def _give(self) -> None:
        if self._arrival.asking and not self._is_asking:
            self._ask()
        samples, self._arrived = self._arrived, []
        if samples:
            if self._is_lossless:
                self._untaken += [(one.number, len(one.payload)) for one in samples]
            self._on_samples(samples)
        if self._is_asked:  # behind what it brought
            self._say()

    # --- what is kept over there

    def _ask(self) -> None:
        self._is_asking = True
        after = records.write_number(self._arrival.last)
        self._session.ask(self._kept_key, after, _ASK_S, self._hear)

    def _hear(self, payload: bytes | None, attachment: bytes | None) -> None:
        if self._is_closed:
            return
        self._is_asking = False
        if payload is None:
            asyncio.get_running_loop().call_later(0.1, self._ask_again)
            return
        found = records.unpack(payload, attachment, marked=True)
        if found is None:
            self._on_broken(f"an answer about {self._topic} can't be read")
            return
        self._arrived += self._arrival.answer(*found)
        self._give()

    def _ask_again(self) -> None:
        if not self._is_closed and not self._is_asking:
            self._ask()

    def _say(self) -> None:
        if self._saying is not None:
            self._saying.cancel()
            self._saying = None
        self._unsaid, self._is_asked = 0, False
        self._session.put(self._word_key, records.write_word(self._arrival.last, self._taken))
