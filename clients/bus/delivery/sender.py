"""How a publisher's encoded samples leave: by its ring, through the broker, or both, in one order.

Samples are written to the ring, where memory is shared, and go to the broker while a match needs that or the
broker keeps the history. What other threads publish joins here. Does not know messages, only their encoding.
"""

from collections.abc import Callable, Container, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from bus import shm
from bus.base.descriptor import Descriptor
from bus.delivery.allowance import QUEUE_BYTES
from bus.delivery.port import Owner, Port
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
from bus.wire import messages as m
from bus.wire.runs import Buffer

if TYPE_CHECKING:  # few programs lend
    from bus.loan import Loan

EndLoan: TypeAlias = "Callable[[Loan, bool], bool]"
LendField: TypeAlias = "Callable[[Any, int, int, type[Loan], EndLoan], Loan | bool | int]"

PublishPacked: TypeAlias = Callable[[Buffer, int], tuple[int, bool]]

_LOOK_S = 1.0
"""How often a waiting publisher looks whether the processes that it waits for still live."""


@cache
def find_loan_class() -> "type[Loan]":
    """Loaded with the first loan, and then at hand: an import in each takes a quarter of its time."""
    from bus.loan import Loan

    return Loan


class Sender:
    """`owner` is the publisher that the port knows; without a `ring` all goes by socket."""

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
        self._is_manual = qos.liveliness is Liveliness.MANUAL_BY_TOPIC
        self._has_deadline = qos.deadline is not None
        self._depth = 0 if qos.history is History.KEEP_ALL else qos.depth
        self.last_ns = port.now_ns()
        """When the last sample was taken. The quick ways don't set it: with a deadline they are off."""
        self._room = port.waiters()
        self._releases = 0  # how often there may have come room
        self._refused_at = -1  # how often that was so when a sample was last refused
        self._lacks_credit = False  # that was for want of room by socket
        self._from_threads = ThreadQueue(QUEUE_BYTES)
        self._socket = SocketSender(port, owner, self._from_threads)
        self._ring = ring
        self._last_by_socket_ns = 0
        self._totals: tuple[int, int] | None = None  # at the end
        self._refusal: BusError | None = None
        self._lent: memoryview | None = None  # what is not yet filled, where there is no ring
        self.refused = 0
        """Loans that found no room at their end, because other threads have published meanwhile."""
        self._socket.recipients.on_fewer = self._fewer_by_socket
        self._bursts = BurstWatch(port.soon, owner.topic_name, logger, is_awaitable=not port.is_shared)
        self._socket.on_replaced = lambda count: self._bursts.note_replaced(count, self._depth)
        self.publish: Callable[[Any], bool | int | bytes] = _no_quick_way
        """The quick way for a message. True or REPORT_DUE: done; False: nothing was done; bytes: `put`
        them."""
        self.sends = sends
        """Learns which quick way there is."""
        self.write: Callable[[Any], bool | int] = _no_quick_way
        """The quick way for an encoded sample. True or REPORT_DUE: done; anything else: ask `put`."""
        self.publish_packed: PublishPacked = _no_packs
        """The quick way for many encoded samples."""
        self.lend_field: LendField = _no_quick_way
        """The quick way for a loan, to be ended by `end_loan`; anything but a Loan: ask `lend`."""
        self._choose_routes()

    @property
    def shared(self) -> tuple[Descriptor, ...]:
        """Descriptors that go with the declaration."""
        return () if self._ring is None else (self._ring.announce(),)

    @property
    def published(self) -> tuple[int, int]:
        """Samples and their bytes."""
        if self._totals is not None:
            return self._totals
        if self._ring is not None:
            return self._ring.writer.samples, self._ring.writer.bytes
        socket = self._socket
        return socket.samples + socket.open_samples, socket.bytes + socket.open_bytes

    @property
    def goes_by_socket(self) -> bool:
        """Whether samples go to the broker, alone or beside the ring."""
        return self._socket.use is not Use.NONE

    def count_expected(self, besides: Container[int]) -> int:
        """Matches by the ring whose reader has not named its slot yet, other than `besides`."""
        return 0 if self._ring is None else self._ring.count_expected(besides)

    @property
    def queued(self) -> int:
        return self._socket.queue.count + self._socket.open_samples + len(self._from_threads.late)

    @property
    def replaced(self) -> int:
        return self._socket.replaced

    # --- samples

    def expect_short(self) -> None:
        """The message at hand has no long field: the quick way may be tried again."""
        if (ring := self._ring) is not None:  # read once: the loop's thread may end it meanwhile
            ring.writer.is_long = False

    def put(self, *parts: Buffer | str) -> bool:
        """Take a sample, in parts, by the slow way, which checks loans, threads and room; from any thread.

        False: there is no room until lossless subscriptions have taken more.
        """
        stamp_ns = self._port.now_ns()
        if not self._port.owns_thread():
            return self._put_from_thread(bytes(joined(parts)), stamp_ns)
        self._check_loan()
        return self._refuse() if self._from_threads.late else self._put_now(parts, stamp_ns)

    def lend(self, before: bytes, size: int, after: bytes) -> "Loan | None":
        """A place for `size` bytes of a sample, the rest of which is known; None where `put` gives False.

        In the ring itself, where there is one. Until it ends, nothing else can be published.
        """
        if not self._port.owns_thread():
            raise LocalProtocolError("a loan can only be had on the event loop's thread")
        self._check_loan()
        if self._from_threads.late:
            self._refuse()
            return None
        start = len(before)
        stop, whole = start + size, start + size + len(after)
        if self._socket.use is not Use.NONE and not self._socket.can_take(whole):
            self._refuse(lacks_credit=True)
            return None
        ring = self._ring
        loan_class = find_loan_class()
        try:
            place = memoryview(bytearray(whole)) if ring is None else ring.lend(whole)
            if place is None:
                self._refuse()
                return None
            place[:start], place[stop:] = before, after
            if ring is None:
                self._lent = place
                self._set_quick()  # the ring's own one takes nothing meanwhile
            return loan_class(place[start:stop], self.end_loan)
        except BaseException:  # in a signal handler, say: nothing would end a loan that has no owner
            self._lent = None
            if ring is None:
                self._choose_routes()
            else:
                ring.writer.is_lent = False
            raise

    def end_loan(self, loan: "Loan", is_wanted: bool) -> bool:
        """End it: publish what it holds, or, unless wanted, drop it. Returns whether it was taken.

        A signal handler that raises before this has begun leaves the loan open.
        """
        if not self._port.owns_thread():
            self._port.soon_threadsafe(self.end_loan, loan, False)
            if is_wanted:
                raise LocalProtocolError("a loan can only be published on the event loop's thread")
            return False
        if loan._finish is None:  # another thread has asked for it twice
            return False
        if self._refusal is not None:
            loan._finish = self._lent = None
            if is_wanted:
                raise again(self._refusal)
            return False
        ring = self._ring
        try:
            if not is_wanted:
                return False
            return self._put_lent(self._lent) if ring is None else self._put_lent_in_ring(ring)
        finally:  # it has ended, also where it could not be published
            loan._finish = self._lent = None
            if ring is not None:
                ring.writer.is_lent = False
            else:
                self._choose_routes()
            self.release_waiters()

    def hand_over(self) -> None:
        """End the run that is open, and send it."""
        self._socket.hand_over()

    async def flush(self) -> None:
        """Wait until all is in the ring, and has been given to the socket where the broker is to get it."""
        self._collect_from_threads()
        while self._from_threads.late:
            await self.wait_for_room()
            self._put_late()
        self._socket.hand_over()
        self._port.flush()
        await self._port.wait_for_drain(self._socket.queue)

    async def wait_for_room(self) -> None:
        """After `put` gave False: wait until it is worth trying again; it may be so by now."""
        if self._refusal is not None:
            raise again(self._refusal)
        # Room is taken by what is still on its way here: hand that over, so that it can be taken.
        self.hand_over()
        if self._is_lent:
            await self._room.wait()
            return
        if self._refused_at != self._releases:  # nobody may be left who would wake this caller
            await self._port.turn()
            return
        ring = None if self._lacks_credit else self._ring
        if ring is not None and not ring.wait_for_room(self.release_waiters):
            await self._port.turn()
            return
        while not await self._room.wait(None if ring is None else _LOOK_S):
            if ring is not None and ring.let_the_dead_go():
                return

    def release_waiters(self) -> None:
        """There may be room."""
        self._releases += 1
        if self._from_threads.late:
            self._put_late()
        self._room.release()

    def drop_queued(self) -> int:
        """Give up what could not be handed over; returns how many samples."""
        return self._socket.drop_queued()

    def end(self, reason: BusError) -> None:
        """Take nothing more."""
        self._totals = self.published
        self._refusal = reason
        self._set_quick()
        self._socket.end()
        if self._ring is not None:
            self._ring.close()
            self._ring = None
        self._room.fail(reason)

    def abandon(self, reason: BusError) -> None:
        """In the child of a fork: what is the parent's is left alone."""
        self._totals = 0, 0
        self._refusal = reason
        self._set_quick()
        self._socket.forget_open()

    # --- the broker

    def first_seq_to_send(self) -> int:
        """The number of the first sample that a broker will get."""
        # What waits goes there, even where no known match needs it any more.
        if self._ring is None or self._socket.use is not Use.NONE or self._socket.queue.runs:
            return self._socket.first_seq_to_send()
        return self._ring.writer.latest + 1

    @property
    def places(self) -> tuple[bytes, ...]:
        """The gids of the subscriptions by socket that were lost and have a place here."""
        return self._socket.recipients.places

    def declared(self, answer: m.Created) -> None:
        self._depth = answer.depth
        self._socket.declared(answer)
        if self._ring is not None:
            self._ring.declared(answer)
        self.release_waiters()

    def disconnected(self) -> None:
        """The broker is gone. Subscriptions read the ring on; what goes by socket waits."""
        self._socket.disconnected()
        if self._ring is not None:
            self._ring.disconnected()

    def watch_turn(self, least_depth: Callable[[], int]) -> None:
        """See `BurstWatch.watch_turn`."""
        self._bursts.watch_turn(lambda: self.published[0], least_depth)

    def reported(self) -> None:
        """The counters were reported; the next sample asks for a report again."""
        self._socket.is_report_due = False
        if self._ring is not None:
            self._ring.writer.is_report_due = False

    def credit(self, seq: int) -> None:
        """All that must acknowledge have taken everything up to `seq` that went by socket."""
        self._socket.recipients.credit(seq)
        self.release_waiters()

    def matched(self, matched: m.Matched) -> None:
        self._socket.recipients.matched(
            matched.other,
            matched.gid,
            matched.qos,
            by_socket=matched.route == "socket",
            last_seq=matched.last_seq,
        )
        if self._ring is None:
            self.release_waiters()
        elif matched.route == "shm":
            self._ring.expect(matched)
        else:
            # What the broker has not got yet goes to the new match, too: else it would see a gap.
            is_ahead = matched.next_seq < self._socket.next_seq
            since_ns = min(matched.at_ns, self._last_by_socket_ns) if is_ahead else matched.at_ns
            self._go_by_socket(self._ring.writer.since(since_ns))

    def attach(self, gid: bytes, attached: m.Attached, descriptors: tuple[Descriptor, ...]) -> None:
        """Raises OSError or ValueError, saying what is wrong with what came."""
        if self._ring is not None:
            self._ring.attach(gid, attached, descriptors)
            self._choose_routes()
        self.release_waiters()

    def set_waiting(self, gid: bytes, *, is_on: bool) -> None:
        """Whether to wait for a lossless subscription. By socket the broker sees to it, with its credit."""
        if self._ring is not None:
            self._ring.set_waiting(gid, is_on=is_on)
        self.release_waiters()

    def rerouted(self, gid: bytes, qos: QoSProfile, rerouted: m.Rerouted) -> None:
        ring, since_ns = self._ring, rerouted.at_ns
        if ring is not None:
            missed = [one for one in ring.missed(qos, since_ns) if one[0] > rerouted.last_seq]
            ring.unmatched(gid, rerouted.other)
            self._socket.catch_up(rerouted.other, missed, since_ns=since_ns)
            self._socket.recipients.matched(rerouted.other, gid, qos, by_socket=True)
            self._go_by_socket([])
            self.release_waiters()

    def keep_place(self, other: int, keep_s: float) -> None:
        """A lossless subscription by socket was lost, and may be back within `keep_s`; 0: it will not be."""
        self._socket.recipients.keep_place(other, keep_s)

    def unmatched(self, other: int, gid: bytes, *, is_lost: bool) -> None:
        was_by_socket = self._socket.recipients.unmatched(other)
        if self._ring is None:
            return
        if not was_by_socket:
            self._ring.unmatched(gid, other, is_lost=is_lost)
        self._choose_routes()
        self.release_waiters()

    # --- inside

    def _choose_routes(self) -> None:
        """Let go by socket only what some subscription reads there, and the history, which the broker
        keeps."""
        ring, socket = self._ring, self._socket
        socket.set_use(is_read=ring is None or socket.recipients.are_there)
        if self._totals is not None or self._from_threads.late or self._has_deadline:
            self._set_quick()
        elif ring is None:
            if self._lent is None:
                self._set_quick(socket.run.publish, socket.run.write)
        elif socket.use is not Use.NONE or self._is_manual:
            self._set_quick()
        else:
            # Subscriptions of this loop get a turn at every hundredth `send`, or their depth loses samples.
            self._set_quick(
                ring.writer.publish if ring.can_publish else None,
                ring.writer.write,
                lend_field=ring.writer.lend_field,
                publish_packed=ring.writer.publish_packed,
                spares_turns=not ring.is_read_here,
            )

    def _set_quick(
        self,
        publish: Callable[[Any], bool | int | bytes] | None = None,
        write: Callable[[Any], bool | int] | None = None,
        *,
        lend_field: "LendField | None" = None,
        publish_packed: PublishPacked | None = None,
        spares_turns: bool = False,
    ) -> None:
        """The quick ways from now on; `spares_turns`: see `Sends`."""
        self.publish = publish or _no_quick_way
        self.write = write or _no_quick_way
        self.lend_field = lend_field or _no_quick_way
        self.publish_packed = publish_packed or _no_packs
        if self.sends is not None:
            self.sends.publish = self.publish
            self.sends.spares_turns = spares_turns

    def _fewer_by_socket(self) -> None:
        """There may be room, and perhaps nobody needs the route socket any more."""
        if self._totals is None:
            self._choose_routes()
            self.release_waiters()

    def _go_by_socket(self, missed: list[Sample]) -> None:
        """A match by socket: send it the samples it has not had, then all samples go by socket, too."""
        ring, socket = self._ring, self._socket
        if ring is not None and socket.use is Use.NONE:
            missed = [sample for sample in missed if sample[0] >= socket.next_seq]
            socket.resume(missed[0][0] if missed else ring.writer.latest + 1)
            for _, stamp_ns, payload in missed:
                self._put_in_socket(payload, stamp_ns)
        self._choose_routes()

    def _put_now(self, parts: Sequence[Buffer | str], stamp_ns: int, *, has_room: bool = False) -> bool:
        """`has_room`: it comes from the threads' queue, where its room by socket is reserved."""
        socket = self._socket
        goes_by_socket = socket.use is not Use.NONE
        if goes_by_socket and not has_room and not socket.can_take(sum(map(len, parts))):
            return self._refuse(lacks_credit=True)
        payload = joined(parts) if goes_by_socket else b""  # first, because it may fail for want of memory
        if self._ring is not None and not self._ring.put(parts, stamp_ns):
            return self._refuse()
        if goes_by_socket:
            self._put_in_socket(payload, stamp_ns)
        self.last_ns = stamp_ns
        return True

    def _refuse(self, *, lacks_credit: bool = False) -> Literal[False]:
        self._refused_at, self._lacks_credit = self._releases, lacks_credit
        return False

    def _put_lent(self, place: memoryview | None) -> bool:
        """Publish what was filled, where there is no ring."""
        assert place is not None, "a loan ends once"
        if len(place) > (most := self._socket.max_bytes):  # the limit of a broker that has come meanwhile
            raise PayloadTooLarge(self._owner.topic_name, size_bytes=len(place), limit_bytes=most)
        is_taken = self._put_now((bytes(place),), self._port.now_ns())
        self.refused += not is_taken
        return is_taken

    def _put_lent_in_ring(self, ring: ShmSender) -> bool:
        payload = bytes(ring.writer.lent()) if self.goes_by_socket else b""
        ring.publish_lent()
        if self._has_deadline or self.goes_by_socket:
            self.last_ns = self._port.now_ns()
        if self.goes_by_socket:
            self._put_in_socket(payload, self.last_ns)
        return True

    @property
    def _is_lent(self) -> bool:
        return self._lent is not None if self._ring is None else self._ring.writer.is_lent

    def _check_loan(self) -> None:
        if self._is_lent:
            raise LocalProtocolError(
                f"a loan on '{self._owner.topic_name}' is open: publish or discard it first"
            )

    def _put_in_socket(self, payload: Buffer, stamp_ns: int) -> None:
        self._last_by_socket_ns = stamp_ns
        if not self._socket.run.add(payload, stamp_ns):
            self._socket.put(payload, stamp_ns)

    def _put_from_thread(self, payload: bytes, stamp_ns: int) -> bool:
        releases = self._releases
        if not self._socket.can_take(len(payload)):
            self._refused_at, self._lacks_credit = releases, True
            return False
        # With a ring, what waits for the loop needs no bound by number: the ring itself keeps the newest.
        depth = self._depth if self._ring is None and self._depth else 1 << 30
        if self._from_threads.put(payload, stamp_ns, depth):
            try:
                self._port.soon_threadsafe(self._collect_from_threads)
            except RuntimeError:
                raise ConnectionClosed(f"the event loop of '{self._owner.topic_name}' has ended") from None
        return True

    def _collect_from_threads(self) -> None:
        """Publish, on the event loop, what other threads have published."""
        skipped = self._from_threads.collect()
        if self._totals is not None:
            return
        if self._ring is None:
            self._socket.skip(skipped)
        else:
            self._socket.replaced += skipped
        self._put_late()
        self._socket.hand_over()

    def _put_late(self) -> None:
        late = self._from_threads.late
        if self._is_lent:
            return  # it goes on when the loan ends
        while late:
            try:
                if not self._put_now(late[0][:1], late[0][1], has_room=True):
                    break
            except (SharedMemoryError, PayloadTooLarge) as error:
                self._logger.error(f"a message of another thread is lost: {error}")
                self._socket.replaced += 1
            self._from_threads.forget_oldest()
        if late and self._ring is not None and not self._ring.wait_for_room(self.release_waiters):
            self._port.soon(self.release_waiters)
        self._choose_routes()


def _no_quick_way(*_: object) -> Literal[False]:
    """Stands for a quick way that is switched off."""
    return False


def _no_packs(*_: object) -> tuple[int, bool]:
    return 0, False
