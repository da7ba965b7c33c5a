"""The way in of one far publisher through zenoh, in order."""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

from bus_bridge.engine import FarEndpoint, Sample
from bus_bridge.packed import number_and_time, payload_bytes
from bus_bridge.zenoh import keys, records
from bus_bridge.zenoh.arrival import Arrival, Untaken
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.records import Assembler, Content, Piece, Probe, Room
from bus_bridge.zenoh.session import Session

__all__ = ["ZenohReader"]

_READER_BYTES = 16 << 20
_PUT_BYTES = 256
"""What a put costs besides what is in it."""
_ASK_S = 1.0
_ASK_FIRST, _ASK_MOST = 4, 16
"""Missing parts that are asked for at a time: zenoh drops many in a row, and each alone would cost a way
there and back. More while answers come."""
_AGAIN_S = 0.1
_SAY_BYTES = 1 << 20
_SAY_S = 0.01


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
        self._untaken = Untaken()
        self._unsaid = 0
        self._saying: asyncio.TimerHandle | None = None
        self._kept_key = keys.kept_key(bus, gid, own.run)
        self._ack_key = keys.ack_key(bus, gid, own.run)
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
        self._untaken.take(size)
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
            if samples and number_and_time(samples, 0)[0] <= self._kept_last:
                samples = [one for one in samples if one.number > self._kept_last]
            self._keep(number, samples)

    def _keep(self, number: int, samples: Sequence[Sample]) -> None:
        """They are to be given on, of the part with that number."""
        if samples:
            self._arrived.append(samples)
        if self._is_lossless:
            self._untaken.add(number, payload_bytes(samples))

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
        ack = records.write_pair(self._arrival.last, self._untaken.last_taken())
        self._session.put(self._ack_key, ack)
