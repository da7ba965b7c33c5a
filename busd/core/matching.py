"""Which publisher and subscription form a match, by which route, and the messages to both.

A match on the route socket starts with the replay of a transient local publisher's history, before anything
new. One on the route shm finds it in the ring.
"""

import logging
from collections.abc import Callable
from operator import attrgetter
from typing import Any

from msgspec import structs

from bus.qos import QoSProfile, check_compatible, describe_incompatibilities
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
from busd.core.bridging import are_for_each_other
from busd.core.effects import Effect, Note, Send
from busd.core.entities import ROUTE_OF, Match, Publisher, Subscription
from busd.core.graph import Graph
from busd.core.work import LOOKS_PER_UNIT, MATCH, QUEUES_PER_UNIT, STAMPS_PER_UNIT

_ACKED_SEQ = attrgetter("acked_seq")


def incompatibility(publisher: Publisher, subscription: Subscription) -> tuple[str, str] | None:
    """Why the two don't match: the policy (or TYPE) and the text; None if they do."""
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


def make_match(
    now_ns: int, graph: Graph, publisher: Publisher, subscription: Subscription, out: list[Effect]
) -> int:
    """Make the match, or tell both ends why there is none; returns the cost."""
    is_plain = publisher.node.origin is None and not subscription.is_tap
    if not (is_plain or are_for_each_other(publisher, subscription)):
        return MATCH
    reason = incompatibility(publisher, subscription)
    if reason is not None:
        if not subscription.is_tap:
            _refuse(publisher, subscription, *reason, out)
        return MATCH
    last_seq = None
    if subscription.is_lossless and subscription.last_seqs:
        last_seq = _repeated_from(publisher, subscription)
    is_shared = last_seq is None and can_share(publisher, subscription)
    match = Match(publisher, subscription, now_ns)
    graph.add_match(match, is_shared=is_shared, last_seq=last_seq)
    route = ROUTE_OF[match.state]
    ring: tuple[Any, ...] = (publisher.ring, publisher.node.peer.doorbell) if is_shared else ()
    offered, requested = publisher.qos, subscription.qos
    if subscription.takes_history and requested.durability is not offered.durability:
        requested = _as_offered(requested, offered)
    awaits_sign = not publisher.is_alive or bool(publisher.is_manual and publisher.lease_ns)
    if awaits_sign and publisher.is_alive and subscription.qos.lease_ns:
        publisher.unaware[subscription.id] = match
    ends: tuple[tuple[Any, Any, QoSProfile, tuple[Any, ...]], ...]
    ends = ((publisher, subscription, requested, ()), (subscription, publisher, offered, ring))
    next_seq = publisher.next_seq if last_seq is None else last_seq + 1
    for mine, other, qos, brings in ends:
        message = Matched(
            endpoint=mine.id,
            other=other.id,
            node=other.node.full_name,
            gid=other.gid,
            qos=qos,
            route=route,
            next_seq=next_seq if mine is subscription else publisher.next_seq,
            at_ns=mine.node.peer.by_its_clock(now_ns) if mine.node.peer.clock_ns else now_ns,
            descriptors=len(brings),
            stands_for=publisher.stands_for if other is publisher else b"",
            is_tap=other is subscription and subscription.is_tap,
            last_seq=last_seq if mine is publisher else None,
            clock_ns=other.node.peer.clock_ns - mine.node.peer.clock_ns,
            awaits_sign=mine is subscription and awaits_sign,
        )
        out.append(Send(mine.node.peer.id, message, brings))
    if subscription.node.peer.is_silent and match.is_lossless:
        silent_ns = now_ns - subscription.node.peer.last_heard_ns
        report_silence(match, silent_ns, out.append)
    if not publisher.is_alive:  # for libraries that do not know `awaits_sign`
        lost = LivelinessChanged(subscription=subscription.id, publisher=publisher.id, alive=False)
        out.append(Send(subscription.node.peer.id, lost))
    if is_shared or subscription.is_mirror:
        return MATCH
    replayed = _replayed_from(match) if publisher.history is not None else None
    price = MATCH + _begin_routing(now_ns, match, replayed, out)
    if last_seq is not None:
        give_credit(publisher, out.append)  # it goes on from there, though the subscription may be silent
        price += len(publisher.awaited) // LOOKS_PER_UNIT
    return price


def _repeated_from(publisher: Publisher, subscription: Subscription) -> int | None:
    """The number after which the publisher is to repeat its samples to a subscription that is back.

    None: the subscription has missed nothing, or the publisher keeps nothing for it. Samples in a ring
    are still there. So if there was a ring, busd must know that this subscription used the socket: busd has
    seen that, or the publisher has said so.
    """
    received_seq = subscription.last_seqs.get(publisher.gid)
    if (
        received_seq is None
        or received_seq + 1 >= publisher.next_seq
        or not publisher.is_lossless
        or subscription.is_mirror
        or publisher.history is not None
        or not publisher.node.peer.keeps_places
    ):
        return None
    may_have_shared = publisher.ring is not None or publisher.has_shared
    if may_have_shared and publisher.node.peer.uid == subscription.node.peer.uid:
        owed = subscription.owed.get(publisher.gid)
        if (owed is None or not owed.first_seq) and subscription.gid not in publisher.places:
            return None
    return received_seq


def _as_offered(qos: QoSProfile, offered: QoSProfile) -> QoSProfile:
    """The request, to a publisher with this offer, of a subscription that takes any history."""
    return structs.replace(qos, durability=offered.durability)


def can_share(publisher: Publisher, subscription: Subscription) -> bool:
    """Whether the match uses shared memory: both processes can, and belong to one user.

    An older program would wait for a silent process for ever; by socket busd prevents that.
    """
    talker, listener = publisher.node.peer, subscription.node.peer
    return (
        publisher.ring is not None
        and not subscription.is_mirror
        and (talker.hears_of_silence or not listener.is_silent)
        and talker.doorbell is not None
        and listener.readers is not None
        and talker.uid == listener.uid
    )


def reroute(now_ns: int, graph: Graph, match: Match, out: list[Effect]) -> None:
    """Put a match on the route socket that was on the route shm, and tell the subscription.

    When the subscription has left the ring (LeaveRing), busd tells the publisher. The publisher sends the
    missing samples to it alone: those of the history, and those published since the match began. When the
    publisher says that this is done (CaughtUp), the subscription gets what all get. So each sample goes one
    way, and is counted once.
    """
    publisher, subscription = match.publisher, match.subscription
    graph.reroute(match)
    at_ns = subscription.node.peer.by_its_clock(match.at_ns)
    told = Rerouted(endpoint=subscription.id, other=publisher.id, route=match.route, at_ns=at_ns)
    out.append(Send(subscription.node.peer.id, told))
    _begin_routing(now_ns, match, None, out)


def end_match(
    graph: Graph, match: Match, out: list[Effect], *, is_lost: bool = False, keep_ns: int = 0
) -> None:
    """End the match and tell both; samples in the queue are still delivered.

    `is_lost`: the process of the end that leaves ended without a goodbye. The publisher keeps the place of a
    subscription for `keep_ns`.
    """
    publisher, subscription = match.publisher, match.subscription
    was_awaited = match.acked_seq is not None
    publisher.unaware.pop(subscription.id, None)
    last_seq = graph.remove_match(match)
    told = Unmatched(endpoint=publisher.id, other=subscription.id, lost=is_lost, keep_s=keep_ns / 1e9)
    out.append(Send(publisher.node.peer.id, told))
    told = Unmatched(endpoint=subscription.id, other=publisher.id, lost=is_lost, last_seq=last_seq)
    out.append(Send(subscription.node.peer.id, told))
    if was_awaited:
        give_credit(publisher, out.append)


def give_credit(publisher: Publisher, emit: Callable[[Effect], None]) -> None:
    """Tell a lossless publisher the number that all awaited subscriptions have acknowledged, if it has
    grown.
    """
    last_seq = publisher.next_seq - 1
    seq: int = min(map(_ACKED_SEQ, publisher.awaited.values()), default=last_seq)
    publisher.is_credit_ahead = seq > last_seq
    seq = min(seq, last_seq)
    if seq > publisher.credited:
        publisher.credited = seq
        publisher.uncredited_bytes = 0
        emit(Send(publisher.node.peer.id, Credit(publisher=publisher.id, seq=seq)))


def report_silence(match: Match, silent_ns: int, emit: Callable[[Effect], None]) -> None:
    """Tell a lossless publisher whether to wait for a lossless subscription."""
    peer, waiting = match.subscription.node.peer, match.publisher.node.peer
    if waiting.hears_of_silence:
        told = Silence(
            publisher=match.publisher.id,
            subscription=match.subscription.id,
            silent_s=max(0, silent_ns) / 1e9,
            is_over=not peer.is_silent,
        )
        emit(Send(waiting.id, told))


def release(match: Match, seq: int, emit: Callable[[Effect], None]) -> None:
    """Count all up to `seq` as acknowledged."""
    if match.acked_seq is not None and seq > match.acked_seq:
        match.acked_seq = seq
        give_credit(match.publisher, emit)


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


def _begin_routing(now_ns: int, match: Match, last_seq: int | None, out: list[Effect]) -> int:
    """From now on queue runs for the match; first the history after `last_seq` (None: none of it).

    Returns what the history costs.
    """
    publisher, subscription = match.publisher, match.subscription
    if match.is_lossless and not subscription.node.peer.is_silent:
        match.await_acks()
    if publisher.lifespan_ns:
        subscription.node.peer.perishable.add(subscription)
    if publisher.history is None or last_seq is None:
        return 0
    expired = publisher.history.drop_expired(now_ns)
    _replay(publisher, publisher.history, subscription, last_seq, out)
    return expired // STAMPS_PER_UNIT + len(publisher.history.runs) // QUEUES_PER_UNIT


def _replayed_from(match: Match) -> int | None:
    """The number after which a new match gets the publisher's history, or None if it gets none."""
    subscription = match.subscription
    received_seq = subscription.last_seqs.get(match.publisher.gid)
    if subscription.takes_history:
        return received_seq or 0
    # Otherwise, only a lossless subscription that was there before has missed something.
    return received_seq if match.is_lossless else None


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
