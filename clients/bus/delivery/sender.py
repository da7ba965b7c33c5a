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
from bus.delivery.port import Owner, Port, Waiters
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
"""At hand for each sample: to find it in its class takes longer."""

_LOOK_S = 1.0
"""How often a waiting publisher looks whether the processes that it waits for still live."""


@cache
def find_loan_class() -> "type[Loan]":
    """Loaded with the first loan, and then at hand: an import in each takes a quarter of its time."""
    from bus.loan import Loan

    return Loan


class QuickWays:
    """The ways past the sender that are open now, most of them native; the others do nothing and give False.

    `sends` learns of `publish`, for `Publisher.send`.
    """

    __slots__ = ("lend_field", "publish", "publish_packed", "sends", "write")

    def __init__(self, sends: "shm.native.Sends | None" = None) -> None:
        self.sends = sends
        self.publish: Publish = _no_quick_way
        """Of a message. True or REPORT_DUE: done; False: nothing was done; bytes: `Sender.put` them."""
        self.write: Write = _no_quick_way
        """Of an encoded sample. True or REPORT_DUE: done; anything else: ask `Sender.put`."""
        self.publish_packed: PublishPacked = _no_packs
        """Of many encoded samples."""
        self.lend_field: LendField = _no_quick_way
        """Of a loan, to be ended by its last argument; anything but a Loan: ask `Sender.lend`."""

    def set(
        self,
        publish: "Publish | None" = None,
        write: "Write | None" = None,
        *,
        lend_field: "LendField | None" = None,
        publish_packed: PublishPacked | None = None,
        spares_turns: bool = False,
    ) -> None:
        """Open these, and close the others; `spares_turns`: see `Sends`."""
        self.publish = publish or _no_quick_way
        self.write = write or _no_quick_way
        self.lend_field = lend_field or _no_quick_way
        self.publish_packed = publish_packed or _no_packs
        if self.sends is not None:
            self.sends.publish = self.publish
            self.sends.spares_turns = spares_turns


class _Room:
    """Whether there may be room again since a sample was refused, and who waits for that."""

    __slots__ = ("_refused_at", "lacks_credit", "releases", "waiters")

    def __init__(self, waiters: Waiters) -> None:
        self.waiters = waiters
        self.releases = 0
        """How often there may have come room."""
        self._refused_at = -1
        self.lacks_credit = False
        """The last sample was refused for want of room by socket."""

    @property
    def has_changed(self) -> bool:
        """Whether there may have come room since a sample was last refused."""
        return self._refused_at != self.releases

    def refuse(self, releases: int | None = None, *, lacks_credit: bool = False) -> Literal[False]:
        """A sample is refused; `releases`: as many as there were when the room was looked for."""
        self._refused_at = self.releases if releases is None else releases
        self.lacks_credit = lacks_credit
        return False


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
        self._depth = 0 if qos.history is History.KEEP_ALL else qos.depth
        self.last_ns = port.now_ns()
        """When the last sample was taken. The quick ways don't set it: with a deadline they are off."""
        self._room = _Room(port.waiters())
        self._from_threads = ThreadQueue(QUEUE_BYTES)
        self.socket = SocketSender(port, owner, self._from_threads)
        self.ring = ring
        self._last_by_socket_ns = 0
        self._totals: tuple[int, int] | None = None  # at the end
        self.refusal: BusError | None = None
        """Why nothing more is taken."""
        self.lending: Lending | None = None
        """None before the first loan."""
        self.socket.recipients.on_fewer = self._fewer_by_socket
        self._bursts = BurstWatch(port.soon, owner.topic_name, logger, is_awaitable=not port.is_shared)
        self.socket.on_replaced = lambda count: self._bursts.note_replaced(count, self._depth)
        self.quick = QuickWays(sends)
        self.choose_routes()

    @property
    def shared(self) -> tuple[Descriptor, ...]:
        """Descriptors that go with the declaration."""
        return () if self.ring is None else (self.ring.announce(),)

    @property
    def published(self) -> tuple[int, int]:
        """Samples and their bytes."""
        if self._totals is not None:
            return self._totals
        if self.ring is not None:
            return self.ring.writer.samples, self.ring.writer.bytes
        socket = self.socket
        return socket.samples + socket.open_samples, socket.bytes + socket.open_bytes

    @property
    def goes_by_socket(self) -> bool:
        """Whether samples go to the broker, alone or beside the ring."""
        return self.socket.use is not _UNUSED

    def count_expected(self, besides: Container[int]) -> int:
        """Matches by the ring whose reader has not named its slot yet, other than `besides`."""
        return 0 if self.ring is None else self.ring.gates.count_unattached(besides)

    @property
    def queued(self) -> int:
        return self.socket.queue.count + self.socket.open_samples + len(self._from_threads.late)

    @property
    def replaced(self) -> int:
        return self.socket.replaced

    # --- samples

    def expect_short(self) -> None:
        """The message at hand has no long field: the quick way may be tried again."""
        if (ring := self.ring) is not None:  # read once: the loop's thread may end it meanwhile
            ring.writer.is_long = False

    def put(self, *parts: Buffer | str) -> bool:
        """Take a sample, in parts, by the slow way, which checks loans, threads and room; from any thread.

        False: there is no room until lossless subscriptions have taken more.
        """
        stamp_ns = self._port.now_ns()
        if not self._port.owns_thread():
            return self._put_from_thread(bytes(joined(parts)), stamp_ns)
        self._check_loan()
        return self._room.refuse() if self._from_threads.late else self.put_now(parts, stamp_ns)

    def lend(self, before: bytes, size: int, after: bytes) -> "Loan | None":
        """A place for `size` bytes of a sample, the rest of which is known; None where `put` gives False.

        In the ring itself, where there is one. Until it ends, nothing else can be published.
        """
        return (self.lending or self.make_lending()).lend(before, size, after)

    def make_lending(self) -> "Lending":
        """For the first loan."""
        from bus.delivery.lending import Lending

        self.lending = Lending(self._port, self._owner, self)
        return self.lending

    @property
    def can_lend(self) -> bool:
        """Whether nothing else comes first; raises LocalProtocolError while a loan is open."""
        self._check_loan()
        return not self._from_threads.late

    @property
    def refused(self) -> int:
        """Loans that found no room at their end."""
        return 0 if self.lending is None else self.lending.refused

    def hand_over(self) -> None:
        """End the run that is open, and send it."""
        self.socket.hand_over()

    async def flush(self) -> None:
        """Wait until all is in the ring, and has been given to the socket where the broker is to get it."""
        self._collect_from_threads()
        while self._from_threads.late:
            await self.wait_for_room()
            self._put_late()
        self.socket.hand_over()
        self._port.flush()
        await self._port.wait_for_drain(self.socket.queue)

    async def wait_for_room(self) -> None:
        """After `put` gave False: wait until it is worth trying again; it may be so by now."""
        if self.refusal is not None:
            raise again(self.refusal)
        # Room is taken by what is still on its way here: hand that over, so that it can be taken.
        self.hand_over()
        if self._is_lent:
            await self._room.waiters.wait()
            return
        if self._room.has_changed:  # nobody may be left who would wake this caller
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
        """There may be room."""
        self._room.releases += 1
        if self._from_threads.late:
            self._put_late()
        self._room.waiters.release()

    def drop_queued(self) -> int:
        """Give up what could not be handed over; returns how many samples."""
        return self.socket.drop_queued()

    def end(self, reason: BusError) -> None:
        """Take nothing more."""
        self._totals = self.published
        self.refusal = reason
        self.quick.set()
        self.socket.end()
        if self.ring is not None:
            self.ring.close()
            self.ring = None
        self._room.waiters.fail(reason)

    def abandon(self, reason: BusError) -> None:
        """In the child of a fork: what is the parent's is left alone."""
        self._totals = 0, 0
        self.refusal = reason
        self.quick.set()
        self.socket.forget_open()

    # --- the broker

    def first_seq_to_send(self) -> int:
        """The number of the first sample that a broker will get."""
        # What waits goes there, even where no known match needs it any more.
        if self.ring is None or self.socket.use is not _UNUSED or self.socket.queue.runs:
            return self.socket.first_seq_to_send()
        return self.ring.writer.latest + 1

    @property
    def places(self) -> tuple[bytes, ...]:
        """The gids of the subscriptions by socket that were lost and have a place here."""
        return self.socket.recipients.places

    def declared(self, answer: m.Created) -> None:
        self._depth = answer.depth
        self.socket.declared(answer)
        if self.ring is not None:
            self.ring.declared(answer)
        self.release_waiters()

    def disconnected(self) -> None:
        """The broker is gone. Subscriptions read the ring on; what goes by socket waits."""
        self.socket.disconnected()
        if self.ring is not None:
            self.ring.disconnected()

    def watch_turn(self, least_depth: Callable[[], int]) -> None:
        """See `BurstWatch.watch_turn`."""
        self._bursts.watch_turn(lambda: self.published[0], least_depth)

    def reported(self) -> None:
        """The counters were reported; the next sample asks for a report again."""
        self.socket.is_report_due = False
        if self.ring is not None:
            self.ring.writer.is_report_due = False

    def credit(self, seq: int) -> None:
        """All that must acknowledge have taken everything up to `seq` that went by socket."""
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
            # What the broker has not got yet goes to the new match, too: else it would see a gap.
            is_ahead = matched.next_seq < self.socket.next_seq
            since_ns = min(matched.at_ns, self._last_by_socket_ns) if is_ahead else matched.at_ns
            self._go_by_socket(self.ring.writer.since(since_ns))

    def attach(self, gid: bytes, attached: m.Attached, descriptors: tuple[Descriptor, ...]) -> None:
        """Raises OSError or ValueError, saying what is wrong with what came."""
        if self.ring is not None:
            self.ring.attach(gid, attached, descriptors)
            self.choose_routes()
        self.release_waiters()

    def set_waiting(self, gid: bytes, *, is_on: bool) -> None:
        """Whether to wait for a lossless subscription. By socket the broker sees to it, with its credit."""
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
        """A lossless subscription by socket was lost, and may be back within `keep_s`; 0: it will not be."""
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
        """Let go by socket only what some subscription reads there, and the history, which the broker
        keeps."""
        ring, socket, qos = self.ring, self.socket, self._owner.qos
        socket.set_use(is_read=ring is None or socket.recipients.are_there)
        if self._totals is not None or self._from_threads.late or qos.deadline is not None:
            self.quick.set()
        elif ring is None:
            if self.lending is not None and self.lending.is_open:
                self.quick.set()
            else:
                self.quick.set(socket.run.publish, socket.run.write)
        elif socket.use is not _UNUSED or qos.liveliness is Liveliness.MANUAL_BY_TOPIC:
            self.quick.set()
        else:
            # Subscriptions of this loop get a turn at every hundredth `send`, or their depth loses samples.
            self.quick.set(
                ring.writer.publish if ring.can_publish else None,
                ring.writer.write,
                lend_field=ring.writer.lend_field,
                publish_packed=ring.writer.publish_packed,
                spares_turns=not ring.gates.is_read_here,
            )

    def _fewer_by_socket(self) -> None:
        """There may be room, and perhaps nobody needs the route socket any more."""
        if self._totals is None:
            self.choose_routes()
            self.release_waiters()

    def _go_by_socket(self, missed: list[Sample]) -> None:
        """A match by socket: send it the samples it has not had, then all samples go by socket, too."""
        ring, socket = self.ring, self.socket
        if ring is not None and socket.use is _UNUSED:
            missed = [sample for sample in missed if sample[0] >= socket.next_seq]
            socket.resume(missed[0][0] if missed else ring.writer.latest + 1)
            for _, stamp_ns, payload in missed:
                self._put_in_socket(payload, stamp_ns)
        self.choose_routes()

    def put_now(self, parts: Sequence[Buffer | str], stamp_ns: int, *, has_room: bool = False) -> bool:
        """`has_room`: it comes from the threads' queue, where its room by socket is reserved."""
        socket = self.socket
        goes_by_socket = socket.use is not _UNUSED
        if goes_by_socket and not has_room and not socket.can_take(sum(map(len, parts))):
            return self._room.refuse(lacks_credit=True)
        payload = joined(parts) if goes_by_socket else b""  # first, because it may fail for want of memory
        if self.ring is not None and not self.ring.put(parts, stamp_ns):
            return self._room.refuse()
        if goes_by_socket:
            self._put_in_socket(payload, stamp_ns)
        self.last_ns = stamp_ns
        return True

    def refuse(self, *, lacks_credit: bool = False) -> Literal[False]:
        """There is no room."""
        return self._room.refuse(lacks_credit=lacks_credit)

    def note_lent(self, payload: bytes) -> None:
        """A loan was published in the ring; `payload`: what it held, if samples go by socket, too."""
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

    def _put_in_socket(self, payload: Buffer, stamp_ns: int) -> None:
        self._last_by_socket_ns = stamp_ns
        if not self.socket.run.add(payload, stamp_ns):
            self.socket.put(payload, stamp_ns)

    def _put_from_thread(self, payload: bytes, stamp_ns: int) -> bool:
        releases = self._room.releases
        if not self.socket.can_take(len(payload)):
            return self._room.refuse(releases, lacks_credit=True)
        # With a ring, what waits for the loop needs no bound by number: the ring itself keeps the newest.
        depth = self._depth if self.ring is None and self._depth else 1 << 30
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
        if self.ring is None:
            self.socket.skip(skipped)
        else:
            self.socket.replaced += skipped
        self._put_late()
        self.socket.hand_over()

    def _take_late(self, payload: bytes, stamp_ns: int) -> bool:
        """Publish what another thread has published; False: there is no room yet."""
        try:
            return self.put_now((payload,), stamp_ns, has_room=True)
        except (SharedMemoryError, PayloadTooLarge) as error:
            self._logger.error(f"a message of another thread is lost: {error}")
            self.socket.replaced += 1
            return True

    def _put_late(self) -> None:
        if self._is_lent:
            return  # it goes on when the loan ends
        self._from_threads.hand_on(self._take_late)
        if (
            self._from_threads.late
            and self.ring is not None
            and not self.ring.wait_for_room(self.release_waiters)
        ):
            self._port.soon(self.release_waiters)
        self.choose_routes()


def _no_quick_way(*_: object) -> Literal[False]:
    """Stands for a quick way that is switched off."""
    return False


def _no_packs(*_: object) -> tuple[int, bool]:
    return 0, False
