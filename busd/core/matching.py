"""Which publisher and subscription form a match, and what both are told.

A match starts with the replay of a transient local publisher's history, before anything new.
"""

import logging
from collections.abc import Callable

from bus.qos import check_compatible, describe_incompatibilities
from bus.wire.messages import Credit, Incompatible, LivelinessChanged, Matched, Unmatched
from bus.wire.runs import RunQueue
from busd.core.effects import Effect, Note, Send
from busd.core.entities import Publisher, Subscription, keeps_history
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
    graph.add_match(publisher, subscription)
    if publisher.is_lossless and subscription.is_lossless:
        publisher.acked[subscription.id] = publisher.next_seq - 1
    if publisher.lifespan_ns:
        subscription.node.peer.perishable.add(subscription)
    for mine, other in ((publisher, subscription), (subscription, publisher)):
        message = Matched(
            endpoint=mine.id,
            other=other.id,
            node=other.node.full_name,
            gid=other.gid,
            qos=other.qos,
            next_seq=publisher.next_seq,
        )
        out.append(Send(mine.node.peer.id, message))
    if not publisher.is_alive:
        lost = LivelinessChanged(subscription=subscription.id, publisher=publisher.id, alive=False)
        out.append(Send(subscription.node.peer.id, lost))
    if publisher.history is not None and keeps_history(subscription.qos):
        publisher.history.drop_expired(now_ns)
        _replay(publisher, publisher.history, subscription, out)


def disconnect(graph: Graph, publisher: Publisher, subscription: Subscription, out: list[Effect]) -> None:
    """Unmake the match and tell both; samples in the queue stay to be delivered."""
    graph.remove_match(publisher, subscription)
    out.append(Send(publisher.node.peer.id, Unmatched(endpoint=publisher.id, other=subscription.id)))
    out.append(Send(subscription.node.peer.id, Unmatched(endpoint=subscription.id, other=publisher.id)))
    if publisher.acked.pop(subscription.id, None) is not None:
        give_credit(publisher, out.append)


def give_credit(publisher: Publisher, emit: Callable[[Effect], None]) -> None:
    """Tell a keep-all publisher what all that must take have taken, where that has grown."""
    seq = min(publisher.acked.values(), default=publisher.next_seq - 1)
    if seq > publisher.credited:
        publisher.credited = seq
        publisher.uncredited_bytes = 0
        emit(Send(publisher.node.peer.id, Credit(publisher=publisher.id, seq=seq)))


def _refuse(
    publisher: Publisher, subscription: Subscription, policy: str, text: str, out: list[Effect]
) -> None:
    for mine, other in ((publisher, subscription), (subscription, publisher)):
        message = Incompatible(
            endpoint=mine.id, topic=mine.topic.name, node=other.node.full_name, policy=policy, text=text
        )
        out.append(Send(mine.node.peer.id, message))
    nodes = f"publisher {publisher.node.full_name} and subscription {subscription.node.full_name}"
    out.append(Note(logging.WARNING, f"no match on '{publisher.topic.name}': {nodes}: {text}"))


def _replay(publisher: Publisher, history: RunQueue, subscription: Subscription, out: list[Effect]) -> None:
    queue = subscription.queue
    for run in history.newest(queue.depth, subscription.last_seqs.get(publisher.gid, 0)):
        queue.append(run)
    if queue.runs:
        out.append(subscription.flush)
