"""The hot path: a run of samples from a publisher to the queues of its matched subscriptions.

Costs one step per run and subscription, whatever the number of samples in the run; no payload is decoded.
A queue that a run overfills is not trimmed at once: the shell first sends what the subscriber's socket takes,
then calls `trim`, so that a subscriber that keeps up loses nothing to batching.
"""

from collections.abc import Callable, Iterable, Iterator

from bus.base.ids import EndpointId
from bus.errors import RemoteProtocolError
from bus.wire.layout import MAX_RUN_SAMPLES, RECORD_HEAD_BYTES
from bus.wire.runs import Run
from busd.core.drops import Drops
from busd.core.effects import Effect
from busd.core.entities import Publisher, Subscription
from busd.core.match import MatchEvent, MatchState
from busd.core.matching import give_credit, release
from busd.core.overload import Overload
from busd.core.work import FRAME, QUEUES_PER_UNIT, SAMPLES_PER_UNIT, TELL, Meter, Work

_MANY_QUEUES = 64


class Router:
    """Routes runs; owns the queues that are over their bound at the moment."""

    def __init__(
        self,
        emit: Callable[[Effect], None],
        drops: Drops,
        overload: Overload,
        meter: Meter,
        *,
        window_bytes: int,
        window_samples: int,
    ) -> None:
        self._emit = emit
        self._drops = drops
        self._overload = overload
        self._meter = meter
        self._credit_bytes = window_bytes // 8
        self._credit_samples = window_samples // 8
        self._overfull: list[Subscription] = []

    @property
    def is_overfull(self) -> bool:
        """Whether `trim` is to be called."""
        return bool(self._overfull)

    def reconfigure(self, *, window_bytes: int, window_samples: int) -> None:
        """Give credit by other windows from now on."""
        # Publishers that are there keep their window: credit must come as often as that needs.
        self._credit_bytes = min(self._credit_bytes, window_bytes // 8)
        self._credit_samples = min(self._credit_samples, window_samples // 8)

    def route(self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect]) -> Work | None:
        """Queue `run` for every matched subscription; where they are many, returns Work that does it.

        Raises RemoteProtocolError where the publisher's numbers go back, or a run claims too many samples.
        """
        size = len(run.body)
        payload_bytes = size - run.count * RECORD_HEAD_BYTES
        if payload_bytes < 0:
            raise RemoteProtocolError(f"data frame claims {run.count} samples in {size} bytes")
        if run.count > MAX_RUN_SAMPLES:
            raise RemoteProtocolError(
                f"data frame of {run.count} samples, a run has {MAX_RUN_SAMPLES} at most"
            )
        if run.only_for:
            self._catch_up(now_ns, publisher, run, out)
            return None
        gap = run.first_seq - publisher.next_seq
        if gap < 0:
            raise RemoteProtocolError(
                f"publisher {publisher.id} sent sample {run.first_seq} after {publisher.next_seq - 1}"
            )
        publisher.next_seq = run.first_seq + run.count
        publisher.samples += run.count
        publisher.bytes += payload_bytes
        routed = publisher.routed
        self._meter.left -= FRAME + run.count // SAMPLES_PER_UNIT
        is_resumed, run.is_resumed = run.is_resumed, False  # of no concern to subscriptions
        limit = publisher.max_message_bytes
        if payload_bytes > limit and self._is_too_large(run, limit):
            return self._refuse_all(now_ns, publisher, run.count, gap, is_loss=not is_resumed)
        run.source = publisher.id
        run.lifespan_ns = publisher.lifespan_ns
        history = publisher.history
        if history is not None and history.append(run):
            history.trim()
            self._overload.bound_history(now_ns, publisher)
        work = None
        if len(routed) > _MANY_QUEUES:
            work = self._distribute(
                now_ns, publisher, run, gap, tuple(routed.values()), is_loss=not is_resumed
            )
        else:
            if gap:
                self.miss(now_ns, publisher, gap, routed.values(), is_loss=not is_resumed)
            for subscription in routed.values():
                queue = subscription.queue
                if queue.append(run):
                    self._overfull.append(subscription)
                if not queue.is_ready:
                    out.append(subscription.flush)
        if publisher.ahead:
            self._admit(now_ns, publisher, run, out, is_loss=not is_resumed)
        if publisher.is_credit_ahead:
            give_credit(publisher, out.append)
        elif publisher.is_lossless and not publisher.awaited:
            publisher.uncredited_bytes += size
            if (
                publisher.uncredited_bytes >= self._credit_bytes
                or publisher.next_seq - publisher.credited > self._credit_samples
            ):
                give_credit(publisher, out.append)
        return work

    def passed_on(self, publisher: Publisher, first_seq: int, count: int, size: int) -> bool:
        """Count a run of `size` bytes, which the shell passes on to its only taker.

        False where only `route` can do it; then nothing is done.
        """
        payload_bytes = size - count * RECORD_HEAD_BYTES
        if (
            first_seq != publisher.next_seq
            or count > MAX_RUN_SAMPLES
            or not 0 <= payload_bytes <= publisher.max_message_bytes
        ):
            return False
        publisher.next_seq = first_seq + count
        publisher.samples += count
        publisher.bytes += payload_bytes
        self._meter.left -= FRAME + count // SAMPLES_PER_UNIT
        return True

    def _distribute(
        self,
        now_ns: int,
        publisher: Publisher,
        run: Run,
        gap: int,
        subscriptions: tuple[Subscription, ...],
        *,
        is_loss: bool,
    ) -> Work:
        """Queue `run` for many `subscriptions`, a few at a time; as `route` does for few."""
        for few in _pieces(publisher, subscriptions):
            if gap:
                self.miss(now_ns, publisher, gap, few, is_loss=is_loss)
            for subscription in few:
                if subscription.queue.append(run):
                    self._overfull.append(subscription)
                self._emit(subscription.flush)
            yield len(few) // QUEUES_PER_UNIT

    def _refuse_all(self, now_ns: int, publisher: Publisher, count: int, gap: int, *, is_loss: bool) -> Work:
        """One of the `count` samples of a run is too large: no subscription gets any."""
        for few in _pieces(publisher, tuple(publisher.routed.values())):
            if gap:
                self.miss(now_ns, publisher, gap, few, is_loss=is_loss)
            for subscription in few:
                self._drops.drop(now_ns, subscription, "too_large", count)
                if publisher.id not in _sources(subscription):
                    release(publisher.matches[subscription.id], publisher.next_seq - 1, self._emit)
            yield TELL * len(few)

    def trim(self, now_ns: int) -> None:
        """Bring the overfull queues within their bounds: oldest samples first, each counted."""
        for subscription in self._overfull:
            queue = subscription.queue
            if subscription in subscription.node.peer.perishable:
                self._drops.expire(now_ns, subscription)
            replaced = queue.trim()
            if replaced:
                self._drops.drop(now_ns, subscription, "replaced", replaced)
            self._overload.bound(now_ns, subscription)
        self._overfull.clear()

    def _catch_up(self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect]) -> None:
        """A run for one subscription, of samples that the others had before; as `route`."""
        self._meter.left -= FRAME + run.count // SAMPLES_PER_UNIT
        match = publisher.matches.get(EndpointId(run.only_for))
        if match is None or match.is_shared or match.state is MatchState.LEAVING:
            return  # the match has ended, or was never rerouted
        subscription = match.subscription
        if run.first_seq + run.count > publisher.next_seq and not publisher.has_shared:
            # A subscription would acknowledge what was never published, and be cut off for that.
            raise RemoteProtocolError(
                f"publisher {publisher.id} sent sample {run.first_seq + run.count - 1} once more, "
                f"the last one is {publisher.next_seq - 1}"
            )
        subscription.expected_besides += run.count
        if match.state is MatchState.CATCHING_UP:
            subscription.remember(publisher, run.first_seq + run.count - 1)
        if self._is_too_large(run, publisher.max_message_bytes):
            self._drops.drop(now_ns, subscription, "too_large", run.count)
            if publisher.id not in _sources(subscription):
                release(match, run.first_seq + run.count - 1, self._emit)
            return
        run.source = publisher.id
        run.lifespan_ns = publisher.lifespan_ns
        run.is_resumed = False
        if subscription.queue.append(run):
            self._overfull.append(subscription)
        out.append(subscription.flush)

    def _admit(
        self, now_ns: int, publisher: Publisher, run: Run, out: list[Effect], *, is_loss: bool
    ) -> None:
        """Route `run` to the AHEAD matches for which something in it is new; from now on they are ROUTED."""
        for match in tuple(publisher.ahead.values()):
            if publisher.next_seq <= match.began_seq:
                continue
            match.on(MatchEvent.REACH)
            subscription = match.subscription
            if lost := max(0, run.first_seq - match.began_seq):
                self._drops.drop(now_ns, subscription, "publisher_queue" if is_loss else "disconnected", lost)
            fresh = run if run.first_seq >= match.began_seq else run.after(match.began_seq - 1)
            if subscription.queue.append(fresh):
                self._overfull.append(subscription)
            out.append(subscription.flush)

    def miss(
        self,
        now_ns: int,
        publisher: Publisher,
        gap: int,
        subscriptions: Iterable[Subscription],
        *,
        is_loss: bool,
    ) -> None:
        for subscription in subscriptions:
            if is_loss:  # the publisher's own queue replaced them before they could be handed over
                self._drops.drop(now_ns, subscription, "publisher_queue", gap)
            elif (match := publisher.matches[subscription.id]).is_return:
                self._drops.drop(
                    now_ns, subscription, "disconnected", gap
                )  # it would have got them, but was away
            else:
                match.began_seq += gap  # these went to others, by another route

    @staticmethod
    def _is_too_large(run: Run, limit: int) -> bool:
        return any(len(payload) > limit for payload, _ in run.records())


def _pieces(publisher: Publisher, subscriptions: tuple[Subscription, ...]) -> Iterator[list[Subscription]]:
    """A few `subscriptions` at a time, of those that are still matched."""
    for start in range(0, len(subscriptions), _MANY_QUEUES):
        some = subscriptions[start : start + _MANY_QUEUES]
        yield [one for one in some if one.id in publisher.routed]


def _sources(subscription: Subscription) -> set[int]:
    """Publishers with samples in the queue of a lossless subscription."""
    return {run.source for run in subscription.queue.runs} if subscription.is_lossless else set()
