"""The rings that one subscription reads: attaching, moving to a larger ring, leaving.

Owns the feeds of its matches, and their slots. The native reader takes the samples and counts losses;
`bus.delivery.receiver` takes from it.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from bus import shm
from bus.base.descriptor import Descriptor
from bus.delivery.match import Feed, FeedEvent, FeedState
from bus.delivery.port import RETURN_S, Owner, Port, ShmPort, Timer
from bus.delivery.sequence import PublisherProxy
from bus.qos import Durability, History, QoSProfile
from bus.shm import segments
from bus.transport.memory import keep_freed_memory
from bus.types.support import TypeSupport
from bus.vocabulary import Route
from bus.wire import messages as m
from bus.wire.bounds import MOST_REMEMBERED
from bus.wire.session import MISSING

_ALL = 1 << 60
_LARGE_RING_BYTES = 2 << 20
"""A larger ring than this has grown, usually because of large messages."""


class ShmReceiver:
    """The rings of `owner`, the subscription that the port knows, and that it is given when samples have
    come.

    `on_missed(count)` is called for samples in unknown rings, in which publishers continued while the broker
    was lost.
    """

    def __init__(
        self,
        port: Port,
        shm_context: ShmPort,
        owner: Owner,
        on_missed: Callable[[int], None],
        *,
        decodes_plainly: bool = False,
    ) -> None:
        qos = owner.qos
        self._port = port
        self._shm_context = shm_context
        self._owner = owner
        self._on_missed = on_missed
        self._wants_history = qos.durability is not Durability.VOLATILE
        self._is_lossless = qos.is_lossless
        self._feeds: dict[bytes, Feed] = {}
        self._positions: dict[bytes, int] = {}  # by gid, the next number after a ring was left
        self._declared_ns = _ALL
        self._lost_ns = _ALL  # when the broker was lost
        self._return: Timer | None = None
        self.reader: shm.native.Reader[PublisherProxy] = shm.native.Reader(
            shm_context.readers, owner, _depth(qos), tells_cursor=self._is_lossless
        )
        if decodes_plainly:
            self.reader.expect_texts(partial(_text_plan, owner.support))

    def declared(self) -> None:
        """Note that a broker knows the subscription now."""
        self._declared_ns = self._port.now_ns()
        if self._lost_ns != _ALL:
            self._return = self._port.later(RETURN_S, self._finish_stale)

    def take_up(
        self, matched: m.Matched, received_seq: int | None, drain: Callable[[], None]
    ) -> tuple[PublisherProxy | None, int | None]:
        """Take up the feed of an earlier broker's match: returns its publisher, if any, and the last known
        number.

        If the match uses the socket now, `drain` is called for waiting samples in the rings. `received_seq`:
        the last number received by socket, or the last one to read here when a broker reported the
        publisher's end.
        """
        self.sweep()  # rings that the reader has left by itself must not count as attached now
        feed = self._feeds.get(matched.gid)
        if feed is not None and (feed.state is FeedState.FINISHING or matched.route != Route.SHM):
            if matched.route != Route.SHM:
                drain()
            if self.leave(matched.gid):  # another ring, or none: continues at the position in this one
                received_seq = None
            feed = None
        received_seq = self.received_seq(matched.gid, received_seq)
        if feed is None:
            return None, received_seq
        feed.proxy.renew(matched)
        return feed.proxy, received_seq

    def received_seq(self, gid: bytes, received_seq: int | None) -> int | None:
        """The last number received of a publisher; `received_seq`: the last one by socket."""
        position = self._positions.get(gid)
        return received_seq if position is None else max(received_seq or 0, position - 1)

    def attach(
        self,
        proxy: PublisherProxy,
        matched: m.Matched,
        descriptors: tuple[Descriptor, ...],
        received_seq: int | None,
    ) -> None:
        """Read the ring of a new match, and inform the publisher; or refuse the route, with the reason.

        `received_seq`: the last number received from this publisher before, if any.
        """
        try:
            slot = self._attach(proxy, matched, descriptors, received_seq)
        except (OSError, ValueError, MemoryError) as error:
            self._refuse(proxy, str(error) or "no memory")
        else:
            attach = m.Attach(subscription=self._owner.id, source=proxy.number, slot=slot)
            self._port.send_about(self._owner, attach)

    def replace(self, proxy: PublisherProxy, descriptors: tuple[Descriptor, ...]) -> None:
        """Append the ring in which the publisher continues; or refuse the route, with the reason."""
        try:
            if not descriptors:
                raise OSError(MISSING)
            self._replace(proxy.gid, descriptors[0])
        except (OSError, ValueError, MemoryError) as error:
            self._refuse(proxy, str(error) or "no memory")

    def finish(self, gid: bytes) -> None:
        """Note that the publisher has gone: samples in its ring may still be taken."""
        feed = self._feeds.get(gid)
        if feed is not None:
            feed.on(FeedEvent.FINISH)
            self.reader.finish(feed.proxy)
            self.sweep()
            self._shm_context.poll_soon()  # a last time: the publisher may not have rung for its last samples

    def conclude(self, gid: bytes, last_seq: int) -> int | None:
        """Note that the publisher has gone while the broker was lost, with this last number.

        Returns the last number received or counted here, if any.
        """
        feed = self._feeds.get(gid)
        if feed is None:
            return self.received_seq(gid, None)
        feed.final_seq = last_seq
        self.finish(gid)
        return last_seq

    def hold(self, shown_gid: bytes, *, is_on: bool) -> bool:
        """Leave a publisher's samples in its ring, or take them again; returns whether that ring is read
        here."""
        held = [feed.proxy for feed in self._feeds.values() if feed.proxy.shown_gid == shown_gid]
        for proxy in held:
            self.reader.hold(proxy, is_on)
        return bool(held)

    def leave(self, gid: bytes) -> bool:
        """Leave a match's ring, because the match uses another way now; `proxy.last_seq` keeps the position.

        Returns whether the ring was read until now.
        """
        feed = self._feeds.pop(gid, None)
        if feed is None:
            return False
        feed.on(FeedEvent.LEAVE)
        next_seq = self.reader.next_seq(feed.proxy)
        if next_seq:  # else the reader has left the ring by itself
            feed.proxy.last_seq = feed.proxy.received_seq = next_seq - 1
            self._remember(gid, next_seq)
        self.reader.detach(feed.proxy)
        self._shm_context.give_back(feed.slot)
        return next_seq != 0

    def sweep(self) -> None:
        """Release slots and feeds of rings that the reader has left by itself."""
        for proxy, reason, next_seq in self.reader.pop_left():
            feed = self._feeds.get(proxy.gid)
            proxy.last_seq = proxy.received_seq = max(proxy.last_seq, next_seq - 1)
            self._remember(proxy.gid, next_seq)
            if feed is not None and feed.proxy is proxy:
                feed.on(FeedEvent.LEAVE)
                del self._feeds[proxy.gid]
                self._shm_context.give_back(feed.slot)
                if feed.final_seq >= next_seq:
                    self._on_missed(feed.final_seq + 1 - next_seq)
                if reason:
                    self._refuse(proxy, reason)

    def disconnected(self) -> None:
        """Note that the broker is gone; reading of the rings continues."""
        self._lost_ns = self._port.now_ns()
        self._cancel_return()
        self.sweep()  # the reader has no position in rings that it has left
        for feed in self._feeds.values():
            feed.proxy.last_seq = self.reader.next_seq(feed.proxy) - 1
            feed.on(FeedEvent.DISCONNECT)

    def poll(self, time_s: float) -> None:
        """After each message, poll for the next one without sleeping, for up to `time_s`."""
        self._shm_context.poll(self, int(time_s * 1e9))

    def close(self) -> None:
        """Leave every feed. Views of taken messages stay readable."""
        self._cancel_return()
        self._shm_context.poll(self, 0)
        for gid in tuple(self._feeds):
            self.leave(gid)

    # --- inside

    def _finish_stale(self) -> None:
        """Finish feeds that the new broker has not matched again after a while: their publishers have
        gone."""
        self._lost_ns = _ALL
        for gid, feed in tuple(self._feeds.items()):
            if feed.state is not FeedState.ATTACHED:
                self.finish(gid)

    def _cancel_return(self) -> None:
        if self._return is not None:
            self._return.cancel()

    def _attach(
        self,
        proxy: PublisherProxy,
        matched: m.Matched,
        descriptors: tuple[Descriptor, ...],
        received_seq: int | None,
    ) -> int:
        """Attach a ring, and return its slot. Raises OSError or ValueError with the fault."""
        if len(descriptors) != matched.descriptors:
            raise OSError(MISSING)
        descriptor, doorbell = descriptors
        before = self._feeds.get(matched.gid)
        if before is not None:
            if before.state is FeedState.ATTACHED:
                raise ValueError("another publisher with its gid is read already")
            before.on(FeedEvent.ATTACH)
            before.matched = matched
            if before.identity != segments.identity(descriptor):
                self._replace(matched.gid, descriptor)
            return before.slot
        slot = self._shm_context.allot_slot()
        if slot is None:  # first, because mapping costs more
            raise OSError("all slots of this process's readers' segment are in use")
        try:
            memory = segments.map_ring(descriptor)
            _make_ready_for(memory.size)
            history = 0
            if self._wants_history and matched.qos.durability is Durability.TRANSIENT_LOCAL:
                history = min(self.reader.depth or _ALL, _depth(matched.qos) or _ALL)
            next_seq = max(received_seq + 1 if received_seq else 0, self._positions.pop(matched.gid, 0))
            # All samples of a publisher that was made later are for us; those already overwritten count as
            # lost.
            is_new = matched.next_seq == 1 and matched.at_ns > self._declared_ns
            keep = self._shm_context.writer_doorbell(doorbell) if self._is_lossless else None
            first_seq = self.reader.attach(
                proxy,
                memory,
                slot,
                start=next_seq or int(is_new),
                # Samples that a new publisher wrote while the broker was away are for us, too.
                since_ns=min(matched.at_ns, self._lost_ns),
                history=history,
                lifespan_ns=matched.qos.lifespan_ns,
                clock_ns=matched.clock_ns,
                doorbell=-1 if keep is None else keep.number,
            )
        except BaseException:
            self._shm_context.give_back(slot)
            raise
        proxy.last_seq = first_seq - 1
        feed = self._feeds[matched.gid] = Feed(self._owner, matched, proxy, slot)
        feed.identity, feed.doorbell = segments.identity(descriptor), keep
        feed.on(FeedEvent.ATTACH)
        self._shm_context.poll_soon()
        return slot

    def _remember(self, gid: bytes, next_seq: int) -> None:
        self._positions[gid] = next_seq
        if len(self._positions) > MOST_REMEMBERED:
            del self._positions[next(iter(self._positions))]

    def _replace(self, gid: bytes, descriptor: Descriptor) -> None:
        feed = self._feeds.get(gid)
        if feed is not None:
            memory = segments.map_ring(descriptor)
            _make_ready_for(memory.size)
            self.reader.extend(feed.proxy, memory)
            feed.identity = segments.identity(descriptor)
            self._shm_context.poll_soon()

    def _refuse(self, proxy: PublisherProxy, text: str) -> None:
        refusal = m.RefuseRoute(endpoint=self._owner.id, other=proxy.number, text=text[:1000])
        self._port.send_about(self._owner, refusal)


def _depth(qos: QoSProfile) -> int:
    return 0 if qos.history is History.KEEP_ALL else qos.depth


def _make_ready_for(ring_bytes: int) -> None:
    if ring_bytes > _LARGE_RING_BYTES:
        keep_freed_memory()  # for the memory of decoded messages


def _text_plan(support: TypeSupport[Any]) -> Any:
    return support.text_plan
