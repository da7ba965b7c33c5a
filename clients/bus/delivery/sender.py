"""Sends a publisher's encoded samples: by its ring, through the broker, or both, in one order.

If memory is shared, all samples are written to the ring. They also go to the broker while a match needs that
or the broker keeps the history. Samples of other threads join here. It does not know messages, only their
encoding.
"""

from collections.abc import Callable, Sequence, Set
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from bus import shm
from bus.base.descriptor import Descriptor
from bus.delivery.allowance import QUEUE_BYTES
from bus.delivery.port import Owner, Port, Waiters
from bus.delivery.ring_size import FOR_EVER
from bus.delivery.shm_sender import ShmSender
from bus.delivery.socket_sender import Sample, SocketSender, Use
from bus.delivery.thread_queue import ThreadQueue
from bus.diagnostics.bursts import BurstWatch
from bus.errors import (
    BusError,
    ConnectionClosed,
    LocalProtocolError,
    PayloadTooLarge,
    SharedMemoryError,
    again,
)
from bus.logger import Logger
from bus.qos import History, Liveliness, QoSProfile
from bus.types.large_fields import joined
from bus.vocabulary import Route
from bus.wire import messages as m
from bus.wire.runs import Buffer

if TYPE_CHECKING:  # few programs lend
    from bus.delivery.lending import Lending
    from bus.loan import Loan

EndLoan: TypeAlias = "Callable[[Loan, bool], bool]"
LendField: TypeAlias = "Callable[[Any, int, int, type[Loan], EndLoan], Loan | bool | int]"

Publish: TypeAlias = Callable[[Any], bool | int | bytes]
Write: TypeAlias = Callable[[Any], bool | int]
PublishPacked: TypeAlias = Callable[[Buffer, int], tuple[int, bool]]

_UNUSED = Use.NONE
"""A global, because each sample needs it, and an attribute of the class takes longer to find."""

_NONE: frozenset[int] = frozenset()

_LOOK_S = 1.0
"""Interval of a waiting publisher's checks whether the processes that it waits for still live."""


@cache
def find_loan_class() -> "type[Loan]":
    """The class Loan, imported with the first loan. An import in each loan takes a quarter of its time."""
    from bus.loan import Loan

    return Loan


class QuickWays:
    """Quick ways past the sender, most of them native. A closed way does nothing and returns False.

    `sends` gets each new `publish`, for `Publisher.send`.
    """

    __slots__ = ("lend_field", "publish", "publish_packed", "sends", "write")

    def __init__(self, sends: "shm.native.Sends | None" = None) -> None:
        self.sends = sends
        self.publish: Publish = _no_quick_way
        """Publishes a message.

        True or REPORT_DUE: done; False: nothing was done; bytes: `Sender.put` them.
        """
        self.write: Write = _no_quick_way
        """Publishes an encoded sample. True or REPORT_DUE: done; any other result: call `Sender.put`."""
        self.publish_packed: PublishPacked = _no_packs
        """Publishes many encoded samples."""
        self.lend_field: LendField = _no_quick_way
        """Makes a loan, which its last argument ends. If the result is no Loan, call `Sender.lend`."""

    def set(
        self,
        publish: "Publish | None" = None,
        write: "Write | None" = None,
        *,
        lend_field: "LendField | None" = None,
        publish_packed: PublishPacked | None = None,
        spares_turns: bool = False,
    ) -> None:
        """Open the given ways, and close the others; `spares_turns`: see `Sends`."""
        self.publish = publish or _no_quick_way
        self.write = write or _no_quick_way
        self.lend_field = lend_field or _no_quick_way
        self.publish_packed = publish_packed or _no_packs
        if self.sends is not None:
            self.sends.publish = self.publish
            self.sends.spares_turns = spares_turns


class _Room:
    """Whether there may be room again since a sample was refused, and the tasks that wait for room."""

    __slots__ = ("_refused_at", "lacks_credit", "releases", "waiters")

    def __init__(self, waiters: Waiters) -> None:
        self.waiters = waiters
        self.releases = 0
        """Number of events after which there may be room."""
        self._refused_at = -1
        self.lacks_credit = False
        """Whether the last sample was refused because the socket route had no room."""

    @property
    def has_changed(self) -> bool:
        """Whether there may be room again since the last refused sample."""
        return self._refused_at != self.releases

    def refuse(self, releases: int | None = None, *, lacks_credit: bool = False) -> Literal[False]:
        """Note a refused sample; `releases`: the value of that attribute at the check for room."""
        self._refused_at = self.releases if releases is None else releases
        self.lacks_credit = lacks_credit
        return False


class Sender:
    """Sends the samples of `owner`, the publisher that the port knows; without a `ring`, all by socket."""

    def __init__(
        self,
        port: Port,
        owner: Owner,
        logger: Logger,
        ring: ShmSender | None,
        sends: "shm.native.Sends | None" = None,
    ) -> None:
        qos = owner.qos
        self._port = port
        self._owner = owner
        self._logger = logger
        self._depth = 0 if qos.history is History.KEEP_ALL else qos.depth
        self.last_ns = port.now_ns()
        """Time of the last sample. The quick ways don't set it, because a deadline closes them."""
        self._room = _Room(port.waiters())
        # Samples of other threads come first: from the first one on, `put` looks at their queue.
        self._from_threads = ThreadQueue(QUEUE_BYTES, lambda: self.quick.set())
        self.socket = SocketSender(port, owner, self._from_threads)
        self.ring = ring
        self._last_by_socket_ns = 0
        self._totals: tuple[int, int] | None = None  # set at the end
        self.refusal: BusError | None = None
        """The error for all further samples, after the end."""
        self.lending: Lending | None = None
        """None before the first loan."""
        self.socket.recipients.on_fewer = self._fewer_by_socket
        self._bursts = BurstWatch(port.soon, owner.topic_name, logger, is_awaitable=not port.is_shared)
        self.socket.on_replaced = lambda count: self._bursts.note_replaced(count, self._depth)
        self.quick = QuickWays(sends)
        self.choose_routes()

    @property
    def shared(self) -> tuple[Descriptor, ...]:
        """Descriptors to send with the declaration."""
        return () if self.ring is None else (self.ring.announce(),)

    @property
    def published(self) -> tuple[int, int]:
        """The number of published samples, and their bytes."""
        if self._totals is not None:
            return self._totals
        if self.ring is not None:
            return self.ring.writer.samples, self.ring.writer.bytes
        socket = self.socket
        return socket.samples + socket.open_samples, socket.bytes + socket.open_bytes

    @property
    def goes_by_socket(self) -> bool:
        """Whether samples go to the broker, instead of the ring or in addition to it."""
        return self.socket.use is not _UNUSED

    @property
    def expected(self) -> Set[int]:
        """The broker's numbers of the subscriptions that can't be woken yet, taps included."""
        return _NONE if self.ring is None else self.ring.gates.expected

    @property
    def queued(self) -> int:
        return self.socket.queue.count + self.socket.open_samples + len(self._from_threads.late)

    @property
    def has_unsent(self) -> bool:
        """Whether samples are neither in the ring nor sent, as far as the loop's thread knows."""
        return bool(self._from_threads.count or self.socket.open_samples or self.socket.queue.runs)

    @property
    def replaced(self) -> int:
        return self.socket.replaced

    # --- samples

    def expect_short(self) -> None:
        """Allow the quick way again, because the current message has no long field."""
        if (ring := self.ring) is not None:  # read once: the loop's thread may end it meanwhile
            ring.writer.is_long = False
        self.socket.run.is_long = False

    def expect_long(self) -> None:
        """Allow long fields of any length in the quick way, because the process is prepared for them."""
        if (ring := self.ring) is not None:
            ring.writer.most_long = FOR_EVER

    def make_way(self, status: int) -> bool:
        """After the quick way's FULL or HELD: make room, if possible; returns whether to try again."""
        ring = self.ring
        return ring is None or ring.make_way(status) or self._room.refuse()

    def put(self, *parts: Buffer | str) -> bool:
        """Take a sample, given in parts, by the slow way, which checks loans, threads and room.

        May be called from any thread. False: there is no room until lossless subscriptions have taken more.
        """
        stamp_ns = self._port.now_ns()
        if not self._port.owns_thread():
            return self._put_from_thread(bytes(joined(parts)), stamp_ns)
        return self.put_now(parts, stamp_ns) if self.may_put() else self._room.refuse()

    def lend(self, before: bytes, size: int, after: bytes) -> "Loan | None":
        """Lend a place for `size` bytes of a sample with a known rest; None if `put` would return False.

        The place is in the ring itself, if there is one. Until the loan ends, nothing else can be published.
        """
        return (self.lending or self.make_lending()).lend(before, size, after)

    def make_lending(self) -> "Lending":
        """Make the object for loans, with the first loan."""
        from bus.delivery.lending import Lending

        self.lending = Lending(self._port, self._owner, self)
        return self.lending

    def may_put(self) -> bool:
        """Publish the samples of other threads first; returns whether there was room for all.

        Raises LocalProtocolError while a loan is open.
        """
        self._check_loan()
        if self._from_threads.count:
            self._collect_from_threads()
        return not self._from_threads.late

    @property
    def refused(self) -> int:
        """The number of loans that found no room at their end."""
        return 0 if self.lending is None else self.lending.refused

    def hand_over(self) -> None:
        """End the open run, and send it."""
        self.socket.hand_over()

    async def flush(self) -> None:
        """Wait until all samples are in the ring, and the socket has accepted those for the broker."""
        self._collect_from_threads()
        while self._from_threads.late:
            await self.wait_for_room()
            self._put_late()
        self.socket.hand_over()
        self._port.flush()
        await self._port.wait_for_drain(self.socket.queue)

    async def wait_for_room(self) -> None:
        """After `put` returned False: wait until there may be room, perhaps not at all."""
        if self.refusal is not None:
            raise again(self.refusal)
        # Samples in the open run take up room. Once handed over, subscriptions can take them.
        self.hand_over()
        if self._is_lent:
            await self._room.waiters.wait()
            return
        if self._room.has_changed:  # after this, no task may be left to wake this caller
            await self._port.turn()
            return
        ring = None if self._room.lacks_credit else self.ring
        if ring is not None and not ring.wait_for_room(self.release_waiters):
            await self._port.turn()
            return
        while not await self._room.waiters.wait(None if ring is None else _LOOK_S):
            if ring is not None and ring.drop_dead_readers():
                return

    def release_waiters(self) -> None:
        """Wake the tasks that wait for room, because there may be some."""
        self._room.releases += 1
        if self._from_threads.late:
            self._put_late()
        self._room.waiters.release()

    def refuse_threads(self, reason: BusError) -> None:
        """Raise `reason` for further samples of other threads. Those taken before are still flushed."""
        self._from_threads.refuse(reason)

    def drop_queued(self) -> int:
        """Drop samples that could not be handed over, and log their number; returns it."""
        late = self._from_threads.drop()
        self.socket.replaced += late
        if lost := late + self.socket.drop_queued():
            from bus.base.counted import counted  # few programs lose messages at their end

            text = f"{counted(lost, 'message')} on '{self._owner.topic_name}' could not be handed over"
            self._logger.warning(text)
        return lost

    def end(self, reason: BusError) -> None:
        """Take no more samples: raise `reason` for them."""
        self._totals = self.published
        self.refusal = reason
        self.quick.set()
        self.socket.end()
        if self.ring is not None:
            self.ring.close()
            self.ring = None
        self._room.waiters.fail(reason)

    def abandon(self, reason: BusError) -> None:
        """End in the child of a fork, without touching anything that belongs to the parent."""
        self._totals = 0, 0
        self.refusal = reason
        self.quick.set()
        self.socket.forget_open()

    # --- the broker

    def first_seq_to_send(self) -> int:
        """The number of the first sample that a broker will get."""
        # Queued runs go to the broker, even if no known match needs them any more.
        if self.ring is None or self.socket.use is not _UNUSED or self.socket.queue.runs:
            return self.socket.first_seq_to_send()
        return self.ring.writer.latest + 1

    @property
    def places(self) -> tuple[bytes, ...]:
        """The gids of lost subscriptions of the socket route that have a place here."""
        return self.socket.recipients.places

    def declared(self, answer: m.Created) -> None:
        self._depth = answer.depth
        self.socket.declared(answer)
        if self.ring is not None:
            self.ring.declared(answer)
        self.release_waiters()

    def disconnected(self) -> None:
        """Note that the broker is gone. Subscriptions continue to read the ring; samples by socket wait."""
        self.socket.disconnected()
        if self.ring is not None:
            self.ring.disconnected()

    def watch_turn(self, least_depth: Callable[[], int]) -> None:
        """See `BurstWatch.watch_turn`."""
        self._bursts.watch_turn(lambda: self.published[0], least_depth)

    def reported(self) -> None:
        """Note that the counters were reported; the next sample requests a report again."""
        self.socket.is_report_due = False
        if self.ring is not None:
            self.ring.writer.is_report_due = False

    def credit(self, seq: int) -> None:
        """Note that all subscriptions that must acknowledge have taken the samples by socket up to `seq`."""
        self.socket.recipients.credit(seq)
        self.release_waiters()

    def matched(self, matched: m.Matched) -> None:
        self.socket.recipients.matched(
            matched.other,
            matched.gid,
            matched.qos,
            by_socket=matched.route == Route.SOCKET,
            last_seq=matched.last_seq,
        )
        if self.ring is None:
            self.release_waiters()
        elif matched.route == Route.SHM:
            self.ring.expect(matched)
        else:
            # Samples that the broker does not have yet go to the new match, too: else it would see a gap.
            is_ahead = matched.next_seq < self.socket.next_seq
            since_ns = min(matched.at_ns, self._last_by_socket_ns) if is_ahead else matched.at_ns
            self._go_by_socket(self.ring.writer.since(since_ns))

    def attach(self, gid: bytes, attached: m.Attached, descriptors: tuple[Descriptor, ...]) -> None:
        """Attach the reader of a match. Raises OSError or ValueError with the fault of its descriptors."""
        if self.ring is not None:
            self.ring.attach(gid, attached, descriptors)
            self.choose_routes()
        self.release_waiters()

    def set_waiting(self, gid: bytes, *, is_on: bool) -> None:
        """Set whether to wait for a lossless subscription.

        On the socket route, the broker's credit decides that.
        """
        if self.ring is not None:
            self.ring.set_waiting(gid, is_on=is_on)
        self.release_waiters()

    def rerouted(self, gid: bytes, qos: QoSProfile, rerouted: m.Rerouted) -> None:
        ring, since_ns = self.ring, rerouted.at_ns
        if ring is not None:
            missed = [one for one in ring.missed(qos, since_ns) if one[0] > rerouted.last_seq]
            ring.unmatched(gid, rerouted.other)
            self.socket.catch_up(rerouted.other, missed, since_ns=since_ns)
            self.socket.recipients.matched(rerouted.other, gid, qos, by_socket=True)
            self._go_by_socket([])
            self.release_waiters()

    def keep_place(self, other: int, keep_s: float) -> None:
        """Note a lost lossless subscription by socket, which may return within `keep_s`; 0: it will not."""
        self.socket.recipients.keep_place(other, keep_s)

    def unmatched(self, other: int, gid: bytes, *, is_lost: bool) -> None:
        was_by_socket = self.socket.recipients.unmatched(other)
        if self.ring is None:
            return
        if not was_by_socket:
            self.ring.unmatched(gid, other, is_lost=is_lost)
        self.choose_routes()
        self.release_waiters()

    # --- inside

    def choose_routes(self) -> None:
        """Use the socket route only if a subscription reads it, or for the history, which the broker
        keeps."""
        ring, socket, qos = self.ring, self.socket, self._owner.qos
        socket.set_use(is_read=ring is None or socket.recipients.are_there)
        self._open_quick_ways(ring, socket, qos)
        if self._from_threads.count:  # perhaps another thread has published, and closed them, meanwhile
            self.quick.set()

    def _open_quick_ways(self, ring: ShmSender | None, socket: SocketSender, qos: QoSProfile) -> None:
        if self._totals is not None or self._from_threads.count or qos.deadline is not None:
            self.quick.set()
        elif ring is None:
            if self.lending is not None and self.lending.is_open:
                self.quick.set()
            else:
                self.quick.set(socket.run.publish, socket.run.write)
        elif socket.use is not _UNUSED or qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self.quick.set()
        else:
            # Subscriptions of this loop need a turn at every hundredth `send`, or their depth loses samples.
            self.quick.set(
                ring.writer.publish if ring.can_publish else None,
                ring.writer.write,
                lend_field=ring.writer.lend_field,
                publish_packed=ring.writer.publish_packed,
                spares_turns=not ring.gates.is_read_here,
            )

    def _fewer_by_socket(self) -> None:
        """Note that a subscription by socket is gone: there may be room, and the route may be unused now."""
        if self._totals is None:
            self.choose_routes()
            self.release_waiters()

    def _go_by_socket(self, missed: list[Sample]) -> None:
        """Use the socket route for a match: send it the missed samples, and from now on all samples."""
        ring, socket = self.ring, self.socket
        if ring is not None and socket.use is _UNUSED:
            missed = [sample for sample in missed if sample[0] >= socket.next_seq]
            socket.resume(missed[0][0] if missed else ring.writer.latest + 1)
            for _, stamp_ns, payload in missed:
                self._put_in_socket(payload, stamp_ns)
        self.choose_routes()

    def put_now(self, parts: Sequence[Buffer | str], stamp_ns: int, *, has_room: bool = False) -> bool:
        """Take a sample on the loop's thread, if there is room; returns whether it was taken.

        `has_room`: the sample comes from the queue of other threads, which reserved its room by socket.
        """
        socket = self.socket
        goes_by_socket = socket.use is not _UNUSED
        if goes_by_socket and not has_room and not socket.can_take(sum(map(len, parts))):
            return self._room.refuse(lacks_credit=True)
        payload: Buffer | shm.native.Parts = b""
        if goes_by_socket:  # first: it fails if memory is lacking
            payload = socket.long_record(parts, stamp_ns) or joined(parts)
        if self.ring is not None and not self.ring.put(parts, stamp_ns):
            return self._room.refuse()
        if goes_by_socket:
            self._put_in_socket(payload, stamp_ns)
        self.last_ns = stamp_ns
        return True

    def refuse(self, *, lacks_credit: bool = False) -> Literal[False]:
        """Note a sample or loan without room, and return False."""
        return self._room.refuse(lacks_credit=lacks_credit)

    def note_lent(self, payload: bytes) -> None:
        """Note a loan published in the ring; `payload`: its content, if samples go by socket, too."""
        if self._owner.qos.deadline is not None or self.goes_by_socket:
            self.last_ns = self._port.now_ns()
        if self.goes_by_socket:
            self._put_in_socket(payload, self.last_ns)

    @property
    def _is_lent(self) -> bool:
        if self.ring is not None:
            return self.ring.writer.is_lent
        return self.lending is not None and self.lending.is_open

    def _check_loan(self) -> None:
        if self._is_lent:
            raise LocalProtocolError(
                f"a loan on '{self._owner.topic_name}' is open: publish or discard it first"
            )

    def _put_in_socket(self, payload: "Buffer | shm.native.Parts", stamp_ns: int) -> None:
        self._last_by_socket_ns = stamp_ns
        if not isinstance(payload, bytes | bytearray | memoryview):
            self.socket.put_long(payload, stamp_ns)
        elif not self.socket.run.add(payload, stamp_ns):
            self.socket.put(payload, stamp_ns)

    def _put_from_thread(self, payload: bytes, stamp_ns: int) -> bool:
        releases = self._room.releases
        # With a ring, samples that wait for the loop need no bound by number: the ring itself keeps the
        # newest.
        depth = self._depth if self.ring is None and self._depth else 1 << 30
        with self._from_threads.lock:
            if self._from_threads.refusal is not None:
                raise again(self._from_threads.refusal)
            has_room = self.socket.can_take(len(payload))
            must_tell = has_room and self._from_threads.put(payload, stamp_ns, depth)
        if not has_room:
            return self._room.refuse(releases, lacks_credit=True)
        if must_tell:
            try:
                self._port.soon_threadsafe(self._collect_from_threads)
            except RuntimeError:
                raise ConnectionClosed(f"the event loop of '{self._owner.topic_name}' has ended") from None
        return True

    def _collect_from_threads(self) -> None:
        """Publish, on the event loop, the samples of other threads."""
        if self._totals is not None:
            self.drop_queued()  # they came during the end
            return
        skipped = self._from_threads.collect()
        if self.ring is None:
            self.socket.skip(skipped)
        else:
            self.socket.replaced += skipped
        self._put_late()
        self.socket.hand_over()

    def _take_late(self, payload: bytes, stamp_ns: int) -> bool:
        """Publish a sample of another thread; False: there is no room yet."""
        try:
            return self.put_now((payload,), stamp_ns, has_room=True)
        except (SharedMemoryError, PayloadTooLarge) as error:
            self._logger.error(f"a message of another thread is lost: {error}")
            self.socket.replaced += 1
            return True

    def _put_late(self) -> None:
        if self._is_lent:
            return  # called again when the loan ends
        self._from_threads.hand_on(self._take_late)
        if (
            self._from_threads.late
            and self.ring is not None
            and not self.ring.wait_for_room(self.release_waiters)
        ):
            self._port.soon(self.release_waiters)
        self.choose_routes()


def _no_quick_way(*_: object) -> Literal[False]:
    """Stands for a closed quick way."""
    return False


def _no_packs(*_: object) -> tuple[int, bool]:
    return 0, False
