"""Passes runs on from the buffer that they were read into: no object, no queue, no copy.

Only runs for one subscription, if its process takes them at once; at a moderate rate all are. The core says
which they are, and counts them. Must not know the other contents of a read, nor which process has the turn.
"""

from collections.abc import Mapping
from time import monotonic_ns

from bus.base.ids import PeerId
from bus.transport.stream import Stream
from bus.wire.layout import DATA_HEAD_BYTES
from busd.core.broker import Broker
from busd.server.peer import PeerConnection

__all__ = ["pass_on"]


def pass_on(broker: Broker, peers: Mapping[PeerId, PeerConnection], connection: PeerConnection) -> bool:
    """Send on the runs at the front of what `connection` has read; returns whether that was all."""
    session, meter, now_ns = connection.stream.session, broker.meter, monotonic_ns()
    reader, runs, is_all = session.reader, 0, False
    taker: Stream | None = None  # of the runs that are readdressed and not yet sent
    while (front := reader.front()) is not None and meter.left > 0 and not session.descriptors:
        endpoint, only_for, first_seq, count, size = front
        if only_for or (way := broker.passage(now_ns, connection.id, endpoint)) is None:
            break
        publisher, subscription = way
        if (owner := peers.get(subscription.flush.peer)) is None:  # the core has yet to forget it
            break
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
