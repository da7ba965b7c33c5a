"""The ways of single publishers through zenoh: out, with what is kept for importers, and in, in order."""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from bus.qos import Durability, Reliability
from bus.qos import History as Kept
from bus_bridge.engine import FarEndpoint, LocalEndpoint, RouteRule, Sample
from bus_bridge.packed import Packed, payload_bytes
from bus_bridge.reasons import LINK_FULL
from bus_bridge.zenoh import keys, records
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.records import Assembler, Content, Part, Piece, Probe, Room
from bus_bridge.zenoh.session import Outlet, Query, Session
from bus_bridge.zenoh.window import History, Window

__all__ = ["ZenohReader", "ZenohWriter"]

_DEPTH = 1000
_READER_BYTES = 16 << 20
_PUT_BYTES = 256
"""What a put costs besides what is in it."""
_ASK_S = 1.0
_ASK_FIRST, _ASK_MOST = 4, 16
"""Missing parts that are asked for at a time: zenoh drops many in a row, and each alone would cost a way
there and back. More while answers come."""
_AGAIN_S = 0.1
_SAY_BYTES = 512 << 10
_SAY_S = 0.01
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
        self.gid = endpoint.gid
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

    @property
    def interests(self) -> frozenset[Interest]:
        return self._interests

    def write(self, samples: Sequence[Sample]) -> int:
        """As `Writer.write`. What a best effort publisher sends beyond the link's speed is lost here."""
        gone = len(samples)
        if self._interests:
            gone = self._fitting(samples)
            if gone < len(samples):
                if self._is_reliable:
                    self._is_held = True
                    self._nudge_later(_NUDGE_S)
                else:
                    self._lost[LINK_FULL] = self._lost.get(LINK_FULL, 0) + len(samples) - gone
            fitting = samples if gone == len(samples) else samples[:gone]
            self._rest += records.pack(fitting, self._number + 1)
            if self._rest:
                self._number = self._rest[-1].number
            self._pump()
            if not self._is_reliable:
                gone = len(samples)
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

    def see_word(self, importer: str, arrived: int, taken: int) -> None:
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

    def _fitting(self, samples: Sequence[Sample]) -> int:
        """How many of them may be written now."""
        room = 0 if self._rest else self._window.room
        if type(samples) is Packed:  # one part
            return len(samples) if room > 0 else 0
        for index, sample in enumerate(samples):
            if room <= 0:
                return index
            room -= len(sample[0])
        return len(samples)

    def _pump(self) -> None:
        """Put what waits for room, as far as there is some."""
        outlet, window, rest = self._outlet, self._window, self._rest
        if not rest or outlet is None or not outlet.is_ready:
            return
        put = outlet.put
        while rest and window.room > 0:
            part = rest.popleft()
            window.add(part)
            put(part.payload, attachment=part.head)
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


class ZenohReader:
    """The way in from one far publisher."""

    def __init__(
        self,
        session: Session,
        own: Interest,
        bus: str,
        endpoint: FarEndpoint,
        room: Room,
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
        self._arrival = Arrival(room)
        self._assembler = Assembler(room)
        self._kept_last = 0
        """Number of the last message that was kept over there before this way began."""
        self._arrived: list[Sequence[Sample]] = []
        self._asked_for: set[int] = set()
        """Missing parts that are on their way here, as answers."""
        self._ask_most = _ASK_FIRST
        self._is_asked = False
        self._is_closed = False
        self._untaken: deque[tuple[int, int]] = deque()
        """Number of each part and the size of the messages that it brought, until the bus has taken them."""
        self._credit = 0
        self._taken = 0
        self._unsaid = 0
        self._saying: asyncio.TimerHandle | None = None
        self._kept_key = keys.kept_key(bus, gid, own.run)
        self._word_key = keys.word_key(bus, gid, own.run)
        # What does not fit is asked for again.
        self._source = session.source(
            self._take, _READER_BYTES, lambda _: None, keeps_oldest=True, after=self._give
        )
        push = self._source.push
        key = keys.data_key(endpoint.topic, endpoint.type_name, endpoint.type_hash, bus, gid)
        # The token last: who sees it may begin to send.
        self._subscriber = session.subscribe(
            key,
            lambda _, payload, attachment: push(
                (payload, attachment), len(payload) + len(attachment or b"") + _PUT_BYTES
            ),
        )
        self._token = session.token(keys.interest_token(own.bus, own.run, bus, gid))
        self._ask()

    @property
    def lost(self) -> dict[str, int]:
        """None: what does not fit here is asked for again."""
        return {}

    def taken(self, size: int) -> None:
        if not self._is_lossless:
            return
        self._credit += size
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
        self._arrival.clear()
        self._assembler.clear()
        self._on_close()

    # --- parts

    def _take(self, put: tuple[bytes, bytes | None]) -> None:
        found = records.read_part(*put)
        if found is None:
            self._on_broken(f"a message on {self._topic} can't be read")
            return
        number, content = found
        self._is_asked |= isinstance(content, Probe)
        self._unpack(self._arrival.arrive(number, content, len(put[0])))

    def _unpack(self, contents: Sequence[Content]) -> None:
        number = self._arrival.last - len(contents)
        for content in contents:
            number += 1
            samples = self._samples(content)
            if samples and samples[0].number <= self._kept_last:
                samples = [one for one in samples if one.number > self._kept_last]
            self._keep(number, samples)

    def _keep(self, number: int, samples: Sequence[Sample]) -> None:
        """They are to be given on, of the part with that number."""
        if samples:
            self._arrived.append(samples)
        if self._is_lossless:
            self._untaken.append((number, payload_bytes(samples)))

    def _samples(self, content: Content) -> Sequence[Sample]:
        if isinstance(content, Piece):
            whole = self._assembler.add(content)
            return [] if whole is None else [whole]
        return [] if isinstance(content, Probe) else content

    def _give(self) -> None:
        arrived, self._arrived = self._arrived, []
        for samples in arrived:
            self._on_samples(samples)
        if self._is_closed:
            return
        if self._arrival.misses:
            self._ask_for_missing()
        if self._is_asked:  # behind what it brought
            self._say()

    # --- what is kept over there

    def _ask(self) -> None:
        question = b"h" + records.write_pair(self._kept_last, self._assembler.size)
        self._session.ask(self._kept_key, question, _ASK_S, self._hear)

    def _hear(self, payload: bytes | None, head: bytes | None) -> None:
        if self._is_closed:
            return
        if payload is None:
            asyncio.get_running_loop().call_later(_AGAIN_S, self._ask_again)
        else:
            self._go_on(is_right=self._hear_kept(payload, head or b""))

    def _ask_again(self) -> None:
        if not self._is_closed:
            self._ask()

    def _go_on(self, *, is_right: bool) -> None:
        if is_right:
            self._give()
        else:
            self._on_broken(f"an answer about {self._topic} can't be read")

    def _hear_kept(self, payload: bytes, head: bytes) -> bool:
        base = records.read_pair(head[:16])
        if base is None:
            return False
        if not head[16:]:
            self._unpack(self._arrival.begin(base[0]))
            return True
        found = records.read_part(payload, head[16:])
        if found is None:
            return False
        samples = [one for one in self._samples(found[1]) if one.number > self._kept_last]
        if samples:
            self._kept_last = samples[-1].number
            self._keep(0, samples)
        elif not self._assembler.size:
            return False  # it would be asked for ever
        self._ask()
        return True

    # --- what is missing

    def _ask_for_missing(self) -> None:
        if len(self._asked_for) >= self._ask_most:
            return
        for number in self._arrival.missing(self._ask_most):
            if number not in self._asked_for:
                self._asked_for.add(number)
                question = b"p" + records.write_pair(number - 1, 0)
                self._session.ask(self._kept_key, question, _ASK_S, partial(self._hear_part, number))

    def _hear_part(self, number: int, payload: bytes | None, head: bytes | None) -> None:
        if self._is_closed:
            return
        if payload is None:
            self._ask_most = 1  # the link is full, or slow
            asyncio.get_running_loop().call_later(_AGAIN_S, self._ask_for_part_again, number)
            return
        self._ask_most = min(self._ask_most + 1, _ASK_MOST)
        self._asked_for.discard(number)
        found = records.read_part(payload, head)
        if found is None:
            self._go_on(is_right=False)
            return
        if not isinstance(found[1], Probe):
            self._unpack(self._arrival.arrive(*found, len(payload)))
        elif number == self._arrival.last + 1:
            self._unpack(self._arrival.skip())
        self._go_on(is_right=True)

    def _ask_for_part_again(self, number: int) -> None:
        self._asked_for.discard(number)
        if not self._is_closed:
            self._ask_for_missing()

    def _say(self) -> None:
        if self._saying is not None:
            self._saying.cancel()
            self._saying = None
        self._unsaid, self._is_asked = 0, False
        while self._untaken and self._untaken[0][1] <= self._credit:
            self._taken, gone = self._untaken.popleft()
            self._credit -= gone
        word = records.write_pair(self._arrival.last, self._taken)
        self._session.put(self._word_key, word)
