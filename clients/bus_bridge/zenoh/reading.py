"""The route in of one far publisher through zenoh, in order."""

import asyncio
from collections.abc import Callable, Sequence

from bus_bridge.batch import Batch, Loose
from bus_bridge.engine import FarEndpoint
from bus_bridge.zenoh import keys, records
from bus_bridge.zenoh.acks import Acks
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.missing import AGAIN_S, ASK_S, Missing
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.records import Assembler, Content, Piece, Probe, Room
from bus_bridge.zenoh.session import Session

__all__ = ["ZenohReader"]

_READER_BYTES = 16 << 20
_PUT_BYTES = 256
"""The cost of a put besides its contents."""


class ZenohReader:
    """The route in from one far publisher."""

    def __init__(
        self,
        session: Session,
        own: Interest,
        bus: str,
        endpoint: FarEndpoint,
        room: Room,
        on_batch: Callable[[Batch], None],
        on_broken: Callable[[str], None],
        on_close: Callable[[], None],
    ) -> None:
        gid, qos = endpoint.gid, endpoint.qos
        self._session = session
        self._topic = endpoint.topic
        self._on_batch = on_batch
        self._on_broken = on_broken
        self._on_close = on_close
        self._is_lossless = qos.is_lossless
        self._arrival = Arrival(room)
        self._assembler = Assembler(room)
        self._kept_key = keys.kept_key(bus, gid, own.run)
        self._kept_last = 0
        """Number of the last message that the far side kept before this route began."""
        self._missing = Missing(session, self._kept_key, self._arrival, self._receive_missing)
        self._acks = Acks(session, keys.ack_key(bus, gid, own.run), self._arrival)
        self._arrived: list[Batch] = []
        self._is_closed = False
        # Parts without room are requested again.
        self._source = session.source(
            self._take, _READER_BYTES, lambda _: None, keeps_oldest=True, after=self._give
        )
        push = self._source.push
        key = keys.data_key(endpoint.topic, endpoint.type_name, endpoint.type_hash, bus, gid)
        # Declare the token last: the bridge that sees it may start to send.
        self._subscriber = session.subscribe(
            key,
            lambda _, payload, attachment: push(
                (payload, attachment), len(payload) + len(attachment or b"") + _PUT_BYTES
            ),
        )
        self._token = session.token(keys.interest_token(own.bus, own.run, bus, gid))
        self._ask_for_kept()

    @property
    def lost(self) -> dict[str, int]:
        """Always empty: parts without room are requested again."""
        return {}

    def taken(self, size: int) -> None:
        if self._is_lossless:
            self._acks.taken(size)

    def close(self) -> None:
        if self._is_closed:
            return
        self._is_closed = True
        self._acks.close()
        self._missing.close()
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
        if content.__class__ is Probe:
            self._acks.is_due = True
        if contents := self._arrival.arrive(number, content, len(put[0])):
            self._unpack(contents)

    def _unpack(self, contents: Sequence[Content]) -> None:
        """Unpack parts that may be passed on."""
        number = self._arrival.last - len(contents)
        for content in contents:
            number += 1
            batch = self._assemble(content) if isinstance(content, Piece | Probe) else content
            if batch is not None and batch.first_number <= self._kept_last:
                batch = self._not_kept(batch)
            if batch is not None:
                self._arrived.append(batch)
            if self._is_lossless:
                self._acks.arrived(number, 0 if batch is None else batch.payload_bytes)

    def _assemble(self, content: Piece | Probe) -> Batch | None:
        whole = None if isinstance(content, Probe) else self._assembler.add(content)
        return None if whole is None else Loose([whole])

    def _not_kept(self, batch: Batch) -> Batch | None:
        return Loose.some([one for one in batch if one.number > self._kept_last])

    def _give(self) -> None:
        arrived, self._arrived = self._arrived, []
        for batch in arrived:
            self._on_batch(batch)
        if self._is_closed:
            return
        if self._arrival.misses:
            self._missing.ask()
        if self._acks.is_due:  # after the messages of the part
            self._acks.send()

    def _receive_missing(self, number: int, payload: bytes, head: bytes | None) -> None:
        found = records.read_part(payload, head)
        if found is None:
            self._break()
            return
        answered, content = found
        is_next = number == self._arrival.last + 1
        if not isinstance(content, Probe):
            if is_next:
                self._unpack(self._arrival.skip_to(answered))
            self._unpack(self._arrival.arrive(answered, content, len(payload)))
        elif is_next:
            self._unpack(self._arrival.skip(answered))
        self._give()

    def _break(self) -> None:
        self._on_broken(f"an answer about {self._topic} can't be read")

    # --- messages kept on the far side

    def _ask_for_kept(self) -> None:
        if not self._is_closed:
            question = b"h" + records.write_pair(self._kept_last, self._assembler.size)
            self._session.ask(self._kept_key, question, ASK_S, self._receive_kept)

    def _receive_kept(self, payload: bytes | None, head: bytes | None) -> None:
        if self._is_closed:
            return
        if payload is None:
            asyncio.get_running_loop().call_later(AGAIN_S, self._ask_for_kept)
        elif self._take_kept(payload, head or b""):
            self._give()
        else:
            self._break()

    def _take_kept(self, payload: bytes, head: bytes) -> bool:
        """Handle an answer with kept messages; returns whether it is readable."""
        base = records.read_pair(head[:16])
        if base is None:
            return False
        if not head[16:]:
            self._assembler.clear()  # a message may have been replaced while it was read
            self._unpack(self._arrival.begin(base[0]))
            return True
        found = records.read_part(payload, head[16:])
        if found is None:
            return False
        content, asked_from = found[1], self._assembler.size
        if isinstance(content, Piece | Probe):
            batch = self._assemble(content)
        else:
            self._assembler.clear()  # the far side no longer keeps the message of these pieces
            batch = content
        if batch is not None and (batch := self._not_kept(batch)) is not None:
            self._kept_last = batch.last_number
            self._arrived.append(batch)
            if self._is_lossless:
                self._acks.arrived(0, batch.payload_bytes)
        elif self._assembler.left_out > self._kept_last:
            self._kept_last = self._assembler.left_out
        elif not self._assembler.size and not asked_from:
            return False  # otherwise it would be requested for ever
        self._ask_for_kept()
        return True
