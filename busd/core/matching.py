"""Which publisher and subscription form a match, by which route, and what both are told.

A match on the route socket starts with the replay of a transient local publisher's history, before anything
new. One on the route shm finds it in the ring.
"""

import logging
from collections.abc import Callable
from typing import Any

from bus.qos import check_compatible, describe_incompatibilities
from bus.wire.messages import (
    Credit,
    Incompatible,
    LivelinessChanged,
    Matched,
    Rerouted,
    Silence,
    Unmatched,
)
from bus.wire.runs import RunQueue
from busd.core.effects import Effect, Note, Send
from busd.core.entities import SHM, SOCKET, Publisher, Sharing, Subscription, keeps_history
from busd.core.graph import Graph


def incompatibility(publisher: Publisher, subscription: Subscription) -> tuple[str, str] | None:
    """Why the two don't match: the policy (or TYPE) and the text; None where they do."""
    if publisher.type != subscription.type:
        offered, requested = publisher.type, subscription.type
        if offered[0] == requested[0]:
            return (
                "TYPE",
                f"both call it {offered[0]}, but their definitions differ ({offered[1]} and {requested[1]})",
            )
        return "TYPE", f"the publisher has {offered[0]}, the subscription {requested[0]}"
    found = check_compatible(publisher.qos, subscription.qos)
    if not found:
        return None
    return found[-1].policy.name, describe_incompatibilities(found)


def connect(
    now_ns: int, graph: Graph, publisher: Publisher, subscription: Subscription, out: list[Effect]
) -> None:
    """Make the match, or tell both why there is none."""
    reason = incompatibility(publisher, subscription)
    if reason is not None:
        _refuse(publisher, subscription, *reason, out)
        return
    is_shared = can_share(publisher, subscription)
    graph.add_match(publisher, subscription, Sharing(now_ns) if is_shared else None)
    publisher.has_shared |= is_shared
    ring: tuple[Any, ...] = (publisher.ring, publisher.node.peer.doorbell) if is_shared else ()
    for mine, other, brings in ((publisher, subscription, ()), (subscription, publisher, ring)):
        message = Matched(
            endpoint=mine.id,
            other=other.id,
            node=other.node.full_name,
            gid=other.gid,
            qos=other.qos,
            route=SHM if is_shared else SOCKET,
            next_seq=publisher.next_seq,
            at_ns=now_ns,
            descriptors=len(brings),
        )
        out.append(Send(mine.node.peer.id, message, brings))
    if subscription.node.peer.is_silent and publisher.is_lossless and subscription.is_lossless:
        silent_ns = now_ns - subscription.node.peer.last_heard_ns
        tell_of_silence(publisher, subscription, silent_ns, out.append)
    if not publisher.is_alive:
        lost = LivelinessChanged(subscription=subscription.id, publisher=publisher.id, alive=False)
        out.append(Send(subscription.node.peer.id, lost))
    if not is_shared:
        known_seq = subscription.last_seqs.get(publisher.gid)
        if keeps_history(subscription.qos):
            known_seq = known_seq or 0
        elif not (publisher.is_lossless and subscription.is_lossless):
            known_seq = None  # only a lossless one, which was there before, has missed something
        _begin_routing(now_ns, publisher, subscription, known_seq, out)


def can_share(publisher: Publisher, subscription: Subscription) -> bool:
    """Whether the match goes by shared memory: both processes can, and belong to one user.

    An older program is not to wait for ever for a process that is silent; by socket busd sees to that.
    """
    talker, listener = publisher.node.peer, subscription.node.peer
    return (
        publisher.ring is not None
        and (talker.hears_of_silence or not listener.is_silent)
        and talker.doorbell is not None
        and listener.readers is not None
        and talker.uid == listener.uid
    )


def reroute(
    now_ns: int, graph: Graph, publisher: Publisher, subscription: Subscription, out: list[Effect]
) -> None:
    """Put a match on the route socket that was on the route shm, and tell the subscription.

    When that has left the ring (LeaveRing), the publisher is told. It sends to the subscription alone what
    that has not had, of its history and of what was published since the match began; when that is said to be
    done (CaughtUp), the subscription gets what all get. So each sample goes one way, and is counted once.
    """
    sharing = publisher.shared[subscription.id]
    graph.reroute(publisher, subscription)
    told = Rerouted(endpoint=subscription.id, other=publisher.id, route=SOCKET, at_ns=sharing.at_ns)
    out.append(Send(subscription.node.peer.id, told))
    _begin_routing(now_ns, publisher, subscription, None, out)


def disconnect(
    graph: Graph,
    publisher: Publisher,
    subscription: Subscription,
    out: list[Effect],
    *,
    is_lost: bool = False,
) -> None:
    """Unmake the match and tell both; samples in the queue stay to be delivered.

    `is_lost`: the subscription's process did not take its leave.
    """
    last_seq = graph.remove_match(publisher, subscription)
    told = Unmatched(endpoint=publisher.id, other=subscription.id, lost=is_lost)
    out.append(Send(publisher.node.peer.id, told))
    told = Unmatched(endpoint=subscription.id, other=publisher.id, last_seq=last_seq)
    out.append(Send(subscription.node.peer.id, told))
    if publisher.acked.pop(subscription.id, None) is not None:
        give_credit(publisher, out.append)


def give_credit(publisher: Publisher, emit: Callable[[Effect], None]) -> None:
    """Tell a keep-all publisher what all that must take have taken, where that has grown."""
    last_seq = publisher.next_seq - 1
    seq = min(publisher.acked.values(), default=last_seq)
    publisher.is_credit_ahead = seq > last_seq
    seq = min(seq, last_seq)
    if seq > publisher.credited:
        publisher.credited = seq
        publisher.uncredited_bytes = 0
        emit(Send(publisher.node.peer.id, Credit(publisher=publisher.id, seq=seq)))


def await_acks(publisher: Publisher, subscription: Subscription) -> None:
    """From now on a lossless publisher waits for what `subscription` has taken by socket."""
    known_seq, last_seq_here = publisher.behind.get(subscription.id, 0), publisher.next_seq - 1
    publisher.acked[subscription.id] = max(last_seq_here, known_seq)
    # Of what it has taken already, and the publisher is yet to send here, nothing will be acknowledged.
    publisher.is_credit_ahead |= known_seq > last_seq_here


def tell_of_silence(
    publisher: Publisher, subscription: Subscription, silent_ns: int, emit: Callable[[Effect], None]
) -> None:
    """Tell a lossless publisher whether to wait for a lossless subscription."""
    peer, waiting = subscription.node.peer, publisher.node.peer
    if waiting.hears_of_silence:
        told = Silence(
            publisher=publisher.id,
            subscription=subscription.id,
            silent_s=max(0, silent_ns) / 1e9,
            is_over=not peer.is_silent,
        )
        emit(Send(waiting.id, told))


def release(
    publisher: Publisher, subscription: Subscription, seq: int, emit: Callable[[Effect], None]
) -> None:
    """Nobody waits for an acknowledgement of what is up to `seq`."""
    if seq > publisher.acked.get(subscription.id, seq):
        publisher.acked[subscription.id] = seq
        give_credit(publisher, emit)


def _refuse(
    publisher: Publisher, subscription: Subscription, policy: str, text: str, out: list[Effect]
) -> None:
    for mine, other in ((publisher, subscription), (subscription, publisher)):
        is_namesake = mine.type != other.type and mine.type[0] == other.type[0]
        message = Incompatible(
            endpoint=mine.id,
            topic=mine.topic.name,
            node=other.node.full_name,
            policy=policy,
            text=text,
            type_hash=other.type[1] if is_namesake else "",
        )
        out.append(Send(mine.node.peer.id, message))
    nodes = f"publisher {publisher.node.full_name} and subscription {subscription.node.full_name}"
    out.append(Note(logging.WARNING, f"no match on '{publisher.topic.name}': {nodes}: {text}"))


def _begin_routing(
    now_ns: int,
    publisher: Publisher,
    subscription: Subscription,
    last_seq: int | None,
    out: list[Effect],
) -> None:
    """From now on runs are queued for the match; first comes the history after `last_seq` (None: nothing)."""
    if publisher.is_lossless and subscription.is_lossless and not subscription.node.peer.is_silent:
        await_acks(publisher, subscription)
    if publisher.lifespan_ns:
        subscription.node.peer.perishable.add(subscription)
    if publisher.history is not None and last_seq is not None:
        publisher.history.drop_expired(now_ns)
        _replay(publisher, publisher.history, subscription, last_seq, out)


def _replay(
    publisher: Publisher, history: RunQueue, subscription: Subscription, last_seq: int, out: list[Effect]
) -> None:
    queue = subscription.queue
    for run in history.newest(queue.depth, last_seq):
        queue.append(run)
        subscription.expected_besides += run.count
        subscription.owe(publisher, run.first_seq)
    if queue.runs:
        out.append(subscription.flush)
