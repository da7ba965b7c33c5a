"""Loans of a publisher: a place for a long field, which the caller fills and then publishes or discards.

With shared memory, the buffer is in the ring itself, so nothing is copied. Otherwise it is a separate buffer.
A publisher has one loan at a time, and publishes nothing else meanwhile. Loaded with the first loan.
"""

from typing import Protocol

from bus.delivery.port import Owner, Port
from bus.delivery.shm_sender import ShmSender
from bus.delivery.socket_sender import SocketSender
from bus.errors import BusError, LocalProtocolError, PayloadTooLarge, again
from bus.loan import Loan
from bus.wire.runs import Buffer


class Lender(Protocol):
    """The methods of the publisher's sender that lending uses."""

    ring: ShmSender | None
    socket: SocketSender
    refusal: BusError | None

    @property
    def goes_by_socket(self) -> bool: ...

    def may_put(self) -> bool:
        """Publish the samples of other threads first; returns whether there was room for all.

        Raises LocalProtocolError while a loan is open.
        """

    def refuse(self, *, lacks_credit: bool = False) -> bool:
        """Note a loan without room, and return False."""

    def put_now(self, parts: tuple[Buffer | str, ...], stamp_ns: int) -> bool: ...

    def note_lent(self, payload: bytes) -> None:
        """Note a loan published in the ring; `payload`: its content, if samples go by socket, too."""

    def choose_routes(self) -> None: ...

    def release_waiters(self) -> None: ...


class Lending:
    """The loans of publisher `owner`, which sends by `sender`."""

    def __init__(self, port: Port, owner: Owner, sender: Lender) -> None:
        self._port = port
        self._owner = owner
        self._sender = sender
        self._place: memoryview | None = None
        self.refused = 0
        """Number of loans without room at their end, because other threads have published meanwhile."""

    @property
    def is_open(self) -> bool:
        """Whether a place outside the ring is lent now. (The ring knows about its own places.)"""
        return self._place is not None

    def lend(self, before: bytes, size: int, after: bytes) -> Loan | None:
        """See `Sender.lend`."""
        if not self._port.owns_thread():
            raise LocalProtocolError("a loan can only be had on the event loop's thread")
        sender, ring = self._sender, self._sender.ring
        if not sender.may_put():
            sender.refuse()
            return None
        start = len(before)
        stop, whole = start + size, start + size + len(after)
        if sender.goes_by_socket and not sender.socket.can_take(whole):
            sender.refuse(lacks_credit=True)
            return None
        try:
            place = memoryview(bytearray(whole)) if ring is None else ring.lend(whole)
            if place is None:
                sender.refuse()
                return None
            place[:start], place[stop:] = before, after
            if ring is None:
                self._place = place
                sender.choose_routes()  # the run's own quick way takes nothing meanwhile
            return Loan(place[start:stop], self.end)
        except BaseException:  # for example of a signal handler: no object would end this loan
            self._place = None
            if ring is None:
                sender.choose_routes()
            else:
                ring.writer.is_lent = False
            raise

    def end(self, loan: Loan, is_wanted: bool) -> bool:
        """End a loan: publish its content, or drop it unless wanted. Returns whether the sample was taken.

        If a signal handler raises an exception before this has begun, the loan stays open.
        """
        if not self._port.owns_thread():
            self._port.soon_threadsafe(self.end, loan, False)
            if is_wanted:
                raise LocalProtocolError("a loan can only be published on the event loop's thread")
            return False
        if loan._finish is None:  # another thread has ended it twice
            return False
        sender = self._sender
        if sender.refusal is not None:
            loan._finish = self._place = None
            if is_wanted:
                raise again(sender.refusal)
            return False
        ring = sender.ring
        try:
            if not is_wanted:
                return False
            return self._put_copy() if ring is None else self._put_in_ring(ring)
        finally:  # it has ended, even if it could not be published
            loan._finish = self._place = None
            if ring is not None:
                ring.writer.is_lent = False
            else:
                sender.choose_routes()
            sender.release_waiters()

    def _put_copy(self) -> bool:
        """Publish the filled buffer, without a ring."""
        place, sender = self._place, self._sender
        assert place is not None, "a loan ends once"
        if len(place) > (most := sender.socket.max_bytes):  # the limit of a new broker
            raise PayloadTooLarge(self._owner.topic_name, size_bytes=len(place), limit_bytes=most)
        is_taken = sender.put_now((bytes(place),), self._port.now_ns())
        self.refused += not is_taken
        return is_taken

    def _put_in_ring(self, ring: ShmSender) -> bool:
        payload = bytes(ring.writer.lent()) if self._sender.goes_by_socket else b""
        ring.publish_lent()
        self._sender.note_lent(payload)
        return True
