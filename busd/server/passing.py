"""Passes runs on from the buffer that they were read into: no object, no queue, no copy.

Only runs for one subscription, or a lone run for several processes, if these take them at once; at a moderate
rate all are. The core says which they are, and counts them. Must not know the other contents of a read, nor
which process has the turn.
"""

from collections.abc import Mapping
from time import monotonic_ns

from bus.base.ids import PeerId
from bus.transport.stream import Stream
from bus.wire.framing import FrameReader, Front
from bus.wire.layout import DATA_HEAD_BYTES
from busd.core.broker import Broker
from busd.core.entities import Publisher
from busd.server.peer import PeerConnection

__all__ = ["pass_on"]

_SEND = 4
"""The cost of one more `send` of a run, in the units of busd.core.work."""
_MOST_SENDS = 64
"""For more subscriptions, the core lets each process pay for its own (busd.core.crowd)."""


def pass_on(broker: Broker, peers: Mapping[PeerId, PeerConnection], connection: PeerConnection) -> bool:
    """Send on the runs at the front of what `connection` has read; returns whether that was all."""
    session, meter, now_ns = connection.stream.session, broker.meter, monotonic_ns()
    reader, runs, is_all = session.reader, 0, False
    taker: Stream | None = None  # of the runs that are readdressed and not yet sent
    while (front := reader.front()) is not None and meter.left > 0 and not session.descriptors:
        endpoint, only_for, first_seq, count, size = front
        if only_for or (publisher := broker.passage(now_ns, connection.id, endpoint)) is None:
            break
        if len(publisher.routed) != 1:
            if not runs and _pass_on_to_all(broker, peers, publisher, reader, front):
                runs, is_all = 1, True
            break
        (subscription,) = publisher.routed.values()
        if subscription.queue.runs or (owner := peers.get(subscription.flush.peer)) is None:
            break  # the core has yet to forget a peer that is not there
        if (stream := owner.stream) is not taker:
            if taker is not None:
                taker.send_now(reader.readdressed(), is_lent=True, number=runs)
                taker = None
            if not stream.is_idle:
                break
        if not broker.passed_on(publisher, first_seq, count, size - DATA_HEAD_BYTES):
            break
        reader.readdress(front, subscription.id, publisher.id)
        taker = stream
        runs += 1
        meter.left -= size >> 12  # the cost to send it, as in Stream.flush
        if reader.is_cut:
            is_all = True
            break
    if taker is not None:
        taker.send_now(reader.readdressed(), is_lent=True, number=runs)
    if runs:
        broker.routing_times.add(runs, monotonic_ns() - now_ns)
    return is_all


def _pass_on_to_all(
    broker: Broker,
    peers: Mapping[PeerId, PeerConnection],
    publisher: Publisher,
    reader: FrameReader,
    front: Front,
) -> bool:
    """Send on the only run of a read to several processes; returns whether it was done.

    The time between two sends is the last process's delay. With a queue and a flush for each it was several
    times as long. A flood comes with several runs a read, and queues send these by one call for each process.
    """
    _, _, first_seq, count, size = front
    if not reader.is_last(front) or len(publisher.routed) > _MOST_SENDS:
        return False
    streams: dict[Stream, int] = {}
    for subscription in publisher.routed.values():
        owner = peers.get(subscription.flush.peer)
        if subscription.queue.runs or owner is None or not owner.stream.is_idle:
            return False
        streams[owner.stream] = subscription.id
    # Subscriptions of one process get the run by one call, from their queues.
    if len(streams) != len(publisher.routed) or not broker.passed_on(
        publisher, first_seq, count, size - DATA_HEAD_BYTES
    ):
        return False
    for stream, number in streams.items():
        stream.send_now(reader.addressed(front, number, publisher.id), is_lent=True)
    reader.readdress(front, 0, 0)
    broker.meter.left -= (_SEND + (size >> 12)) * len(streams)
    return True
