"""The publishers of one subscription, and losses and repetitions found by the numbers of their samples.

Owns the last number received from each publisher, by any route. So no sample is received twice, and each
missing sample is noticed, wherever it was lost. Must not know the use of samples, and not the reasons of
losses.
"""

from collections import deque
from collections.abc import Callable

from bus.qos import Durability, History, QoSProfile
from bus.vocabulary import DropReason, Route
from bus.wire.bounds import MOST_REMEMBERED
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import Matched
from bus.wire.runs import Run

_MOST_GONE = 64
_MOST_GAPS = 64


class PublisherProxy:
    """One publisher: the last number received from it, the last taken, and unacknowledged samples."""

    __slots__ = (
        "acked_seq",
        "clock_ns",
        "gaps",
        "gid",
        "is_new",
        "is_rerouted",
        "kept",
        "last_seq",
        "lifespan_ns",
        "may_repeat",
        "needs_ack",
        "number",
        "received_seq",
        "replayed_seq",
        "routed_seq",
        "shown_gid",
        "taken_seq",
        "unacked_bytes",
    )

    def __init__(self, number: int, gid: bytes, last_seq: int, lifespan_ns: int, *, needs_ack: bool) -> None:
        self.number = number
        self.gid = gid
        self.shown_gid = gid  # the gid that users see
        self.last_seq = last_seq
        self.lifespan_ns = lifespan_ns  # from a stamp of its clock to an end by ours
        self.clock_ns = 0  # lead of its clock, of another time namespace, over ours
        self.needs_ack = needs_ack
        self.may_repeat = needs_ack  # whether it may resend missed samples, which it keeps
        self.received_seq = 0  # by ring, or from an earlier broker: not even a replay repeats these
        self.is_new = True  # until its first run that is no replay
        # The last number received of its history, until its first new sample: the rest of the history may
        # follow.
        self.replayed_seq: int | None = None
        # Until the first run by the other route, which shows the losses between the two:
        self.is_rerouted = False
        self.routed_seq = 0  # after its end: the last number that the broker has routed
        # Samples published while it was away, as pairs of numbers (the last before, the first after), until a
        # later run comes:
        self.gaps: tuple[tuple[int, int], ...] = ()
        # The most samples of its history that the broker may have dropped in an earlier connection, and gets
        # again:
        self.kept = 0
        self.taken_seq = self.acked_seq = last_seq
        self.unacked_bytes = 0

    def renew(self, matched: Matched) -> None:
        """Set the values that differ between brokers: number, clock and lifespan."""
        self.number, self.clock_ns = matched.other, matched.clock_ns
        lifespan_ns = matched.qos.lifespan_ns
        self.lifespan_ns = lifespan_ns and (lifespan_ns - matched.clock_ns or 1)

    def comes_back(self, routed_seq: int, next_seq: int) -> None:
        """Note a return: the broker has received the samples up to `routed_seq`, and gets those from
        `next_seq` on."""
        if routed_seq + 1 < next_seq:
            self.gaps = (*self.gaps, (routed_seq, next_seq))[-_MOST_GAPS:]
            self.routed_seq = next_seq - 1
        self.is_new = False  # the broker reports the samples that it did not route to us meanwhile


class SequenceTracker(dict[int, PublisherProxy]):
    """The publishers by their numbers at the broker.

    `on_lost(reason, count)` is called for losses between two routes or brokers. In all methods, `reported` is
    the number of samples that the present broker has reported as dropped for this subscription. `last_seqs`:
    the last number received, by gid, of the publishers of earlier connections.
    """

    def __init__(self, on_lost: Callable[[str, int], None]) -> None:
        super().__init__()
        self._on_lost = on_lost
        self.last_seqs: dict[bytes, int] = {}
        self._gone: deque[int] = deque()
        self.received = 0
        """Samples received by socket; repeated ones count once."""
        self.repeated = 0
        """Samples that the present broker sent, and that had come before, for example by a ring."""
        self.lost_between = 0
        """Samples lost between two routes or two brokers; `on_lost` was called for them."""
        # Missing numbers of samples from the present broker:
        self._skipped = 0  # the broker has dropped them
        self._perhaps_skipped = 0  # the broker has dropped them, or they only went to other readers of rings
        self._rerouted = 0  # the broker has dropped them, or the ring had dropped them before
        self._resent = 0  # the broker has dropped them from a history, or the history lacked them
        self._reported_ahead = 0  # drops of the last broker with numbers above the last received one
        self._lost_at_end: dict[bytes, int] = {}  # of departed publishers, by gid
        # For each gid: the part of `_perhaps_skipped` before the first received sample, and the number of
        # that sample. Then the same of the last broker, until the present one reports our first sample:
        self._beginnings: dict[bytes, tuple[int, int]] = {}
        self._unsure: dict[bytes, tuple[int, int]] = {}
        self._unsure_count = 0
        self._reported_besides = 0  # drops of the last broker in addition to `_skipped`
        # Dropped samples that will be found missing, by reason; and the number found missing before their
        # reason:
        self._reasons: dict[str, int] = {}
        self._unexplained = 0

    def forget(self, number: int, routed_seq: int = 0) -> None:
        """Note a departed publisher. Its samples may still come, so the latest of these publishers are kept.

        The broker has routed its samples up to `routed_seq`, and reports each drop.
        """
        if (proxy := self.get(number)) is not None:
            proxy.routed_seq = max(proxy.routed_seq, routed_seq)
        self._gone.append(number)
        if len(self._gone) > _MOST_GONE and (oldest := self.pop(self._gone.popleft(), None)) is not None:
            self._remember([oldest])

    def match(
        self, matched: Matched, received_seq: int | None, qos: QoSProfile, *, is_new_broker: bool
    ) -> PublisherProxy:
        """Add a publisher matched with a subscription of `qos` that has received its samples up to
        `received_seq`."""
        last_seq = matched.next_seq - 1 if received_seq is None else received_seq
        needs_ack = qos.is_lossless and matched.qos.is_lossless
        proxy = PublisherProxy(matched.other, matched.gid, last_seq, 0, needs_ack=needs_ack)
        proxy.renew(matched)
        proxy.shown_gid = matched.stands_for or matched.gid
        proxy.received_seq = received_seq or 0
        if matched.route != Route.SOCKET:
            return proxy
        has_history = matched.qos.durability is Durability.TRANSIENT_LOCAL
        is_volatile = not has_history or qos.durability is Durability.VOLATILE
        proxy.may_repeat |= not is_volatile
        if has_history:
            proxy.kept = matched.qos.depth if matched.qos.history is History.KEEP_LAST else MAX_COUNT
        if received_seq is None:
            if has_history and not is_volatile and matched.next_seq > 1:
                proxy.replayed_seq = 0
            return proxy
        # The subscription existed before: the broker counts all samples missing from now on as dropped. So
        # they are lost, even if the broker has no time to report them.
        proxy.is_new = False
        if matched.next_seq - 1 > received_seq:
            # A lossless publisher resends samples that were lost with a broker; histories come anyway.
            if is_volatile and not (needs_ack and (has_history or is_new_broker)):
                self.lose_while_away(matched.next_seq - 1 - received_seq, matched.gid)
                proxy.last_seq = matched.next_seq - 1
            else:
                proxy.comes_back(received_seq, matched.next_seq)
        return proxy

    def take_back(self, matched: Matched) -> PublisherProxy | None:
        """Take back a departed publisher that has returned; its earlier samples may still come."""
        for number in self._gone:
            proxy = self.get(number)
            if proxy is not None and proxy.gid == matched.gid:
                proxy.renew(matched)
                if matched.route == Route.SOCKET:  # a ring has them all
                    proxy.comes_back(proxy.routed_seq, matched.next_seq)
                return proxy
        return None

    def disconnected(self, reported: int, lapped_reason: str) -> None:
        """Note that the broker is gone, and with it its numbers of publishers.

        Drops that it had no time to report count as lost with it.
        """
        gone = set(self._gone)
        ends = {
            proxy.gid: proxy.routed_seq - proxy.last_seq
            for proxy in self.values()
            if proxy.number in gone
            and proxy.routed_seq > proxy.last_seq
            and not (proxy.may_repeat or proxy.kept)  # else they may come again if it returns
        }
        # Matched publishers come last: the bound forgets departed ones first.
        self._remember(sorted(self.values(), key=lambda proxy: proxy.number not in gone))
        self.clear()
        self._gone.clear()
        # A departed publisher sends nothing more. So the missing samples of its end are lost now. They must
        # not explain missing samples of another publisher, and must not count a second time.
        for gid, count in ends.items():
            self._skipped += count
            self._lost_at_end[gid] = self._lost_at_end.pop(gid, 0) + count
        for gid in [*self._lost_at_end][:-MOST_REMEMBERED]:
            del self._lost_at_end[gid]
        absent, lapped = self._absent(reported), self.lapped(reported)
        self._lose(absent)
        self._reasons.clear()
        if lapped:
            self.lost_between += lapped
            self._on_lost(lapped_reason, lapped)
        unreported = self._skipped - reported
        self._unexplained = absent
        self._unsure, self._beginnings = self._beginnings, {}
        self._unsure_count, self._perhaps_skipped = self._perhaps_skipped, 0
        self._reported_besides = max(0, -unreported - self._rerouted - self._resent)
        if unreported > 0:
            self._unexplained += self.lose_while_away(unreported)
        else:
            self._reported_ahead += max(0, self._reported_besides - self._unsure_count)
        self._skipped = self._rerouted = self._resent = self.repeated = 0

    @property
    def missing(self) -> int:
        """Missing numbers among the samples of the present broker, wherever they were lost."""
        return self._skipped + self._rerouted + self._resent

    def lapped(self, reported: int) -> int:
        """The part of `missing` that a ring dropped before its match changed to the socket route."""
        return min(self._rerouted, max(0, self._skipped + self._rerouted - reported))

    def absent(self, reported: int) -> dict[str, int]:
        """The part of `missing` that was published while the subscription was away, and that the publisher's
        history lacked: by reason."""
        return self._reasons_of(self._absent(reported))

    def lose_while_away(self, count: int, gid: bytes | None = None) -> int:
        """Count `count` samples of publisher `gid` as lost between two connections.

        It leaves out samples that the last broker reported, and samples that were counted as lost at the loss
        of that broker. Returns the number counted.
        """
        if gid is not None:
            count -= self._known_at_end(gid, count)
        lost = count - min(self._reported_ahead, count)
        self._reported_ahead -= count - lost
        self._lose(lost)
        return lost

    def claim_ahead(self, proxy: PublisherProxy) -> int:
        """The number of reported drops of the last broker that `proxy`, just matched, may bring again.

        A queue dropped them, and the publisher's history or a resend may have them. They count no longer as
        dropped: the caller passes them to `explain_ahead`.
        """
        missing = sum(returned_seq - routed_seq - 1 for routed_seq, returned_seq in proxy.gaps)
        claimed = min((missing if proxy.may_repeat else 0) + proxy.kept, self._reported_ahead)
        self._reported_ahead -= claimed
        return claimed

    def explain_ahead(self, reason: str, count: int) -> None:
        """Note the reason of drops from `claim_ahead`: those that do not come again are found missing."""
        self._reasons[reason] = self._reasons.get(reason, 0) + count

    def note_received(self, gid: bytes, received_seq: int | None) -> None:
        """Note the last number received of an unmatched publisher, taken from its ring."""
        if received_seq is not None:
            self.last_seqs[gid] = max(self.last_seqs.get(gid, 0), received_seq)

    def lose(self, count: int) -> None:
        """Count samples of a ring that was never seen here: its publisher grew while the broker was away."""
        self.lost_between += count
        self._on_lost(DropReason.DISCONNECTED, count)

    def learn(self, missed: dict[bytes, tuple[int, int]]) -> None:
        """Note the first numbers for this subscription, as in Dropped: they show the drops before the first
        received sample."""
        skipped = 0
        ahead = max(0, self._reported_besides - self._unsure_count)
        for gid, (first_seq, _) in missed.items():
            if first_seq and gid in self._unsure:
                count, came_seq = self._unsure.pop(gid)
                self._unsure_count -= count
                skipped += min(count, max(0, came_seq - first_seq))
        unreported = skipped - self._reported_besides
        self._reported_besides = max(0, -unreported)
        self._reported_ahead += max(0, self._reported_besides - self._unsure_count) - ahead
        if unreported > 0:
            self.lose_while_away(unreported)

    def miss(self, missed: dict[bytes, tuple[int, int]]) -> None:
        """Count missing samples of publishers that sent them since then, by their numbers in
        Dropped."""
        for gid, (first_seq, last_seq) in missed.items():
            # Without a first number, the match used a ring. A subscription that never read that ring, but has
            # an earlier number of the publisher, has missed all later samples. Without a number, it counts
            # none.
            received_seq = max(self.last_seqs.get(gid, 0 if first_seq else last_seq), first_seq - 1)
            self.last_seqs[gid] = max(received_seq, last_seq)
            self.lose_while_away(max(0, last_seq - received_seq), gid)
        self._forget_oldest()

    def explain(self, dropped: dict[str, int]) -> None:
        """Note drops of the last broker, by reason: some of these samples are found missing only later."""
        for reason, count in dropped.items():
            known = min(self._unexplained, max(0, count))  # found missing already
            self._unexplained -= known
            self._reasons[reason] = max(0, count - known)

    def check_run(self, proxy: PublisherProxy, run: Run) -> bool:
        """Handle a run that is not simply the next one: cut off repeated samples, count missing ones.

        Returns whether any samples are left.
        """
        received_seq = proxy.received_seq if run.is_replay else proxy.last_seq
        if proxy.replayed_seq is not None:
            proxy.replayed_seq = run.first_seq + run.count - 1 if run.is_replay else None
        if run.first_seq <= received_seq and not self._cut_repeated(run, received_seq):
            return False
        missing = max(0, run.first_seq - proxy.last_seq - 1) - self._pass_gaps(proxy, run.first_seq)
        if run.source != proxy.number:
            self._skipped += missing  # the run was sent before the publisher's end
            return True
        if proxy.is_rerouted:
            self._rerouted += missing
        elif proxy.is_new:
            self._perhaps_skipped += missing
            self._beginnings[proxy.gid] = missing, run.first_seq
            if len(self._beginnings) > MOST_REMEMBERED:
                del self._beginnings[next(iter(self._beginnings))]
        else:
            self._skipped += missing
        proxy.is_rerouted = False
        proxy.is_new &= run.is_replay
        return True

    def _known_at_end(self, gid: bytes, count: int) -> int:
        """The part of `count` missing samples of a returned publisher that was lost with its end before."""
        return min(count, self._lost_at_end.pop(gid, 0)) if count else 0

    def _absent(self, reported: int) -> int:
        return min(self._resent, max(0, self.missing - reported))

    def _reasons_of(self, count: int) -> dict[str, int]:
        """Reasons of `count` missing samples, as far as they are known."""
        found = dict[str, int]()
        for reason, known in self._reasons.items():
            if some := min(known, count):
                found[reason] = some
                count -= some
        if count:
            found[DropReason.DISCONNECTED] = found.get(DropReason.DISCONNECTED, 0) + count
        return found

    def _lose(self, count: int) -> None:
        self.lost_between += count
        for reason, some in self._reasons_of(count).items():
            if reason in self._reasons:
                self._reasons[reason] = max(0, self._reasons[reason] - some)
            self._on_lost(reason, some)

    def _remember(self, proxies: list[PublisherProxy]) -> None:
        for one in proxies:
            last_seq = one.last_seq if one.replayed_seq is None else one.replayed_seq
            if one.replayed_seq != 0:  # else no history has come: next time all of it comes
                self.last_seqs.pop(one.gid, None)
                self.last_seqs[one.gid] = max(0, min(last_seq, MAX_COUNT))  # a ring's number may be false
        self._forget_oldest()

    def _forget_oldest(self) -> None:
        for gid in [*self.last_seqs][:-MOST_REMEMBERED]:
            del self.last_seqs[gid]

    def _pass_gaps(self, proxy: PublisherProxy, first_seq: int) -> int:
        """Count samples missing before `first_seq` because no broker received them; returns their number."""
        gone = 0
        for routed_seq, returned_seq in proxy.gaps:
            gone += max(0, min(returned_seq, first_seq) - max(routed_seq, proxy.last_seq) - 1)
        proxy.gaps = tuple(gap for gap in proxy.gaps if first_seq < gap[1])
        if proxy.may_repeat:  # the broker may have had them again, and dropped them
            self._resent += gone - self._known_at_end(proxy.gid, gone)
        else:
            self.lose_while_away(gone, proxy.gid)
        return gone

    def _cut_repeated(self, run: Run, received_seq: int) -> bool:
        known = received_seq + 1 - run.first_seq
        self.repeated += min(known, run.count)
        if known >= run.count:
            return False
        rest = run.after(received_seq)
        run.first_seq, run.count, run.body = rest.first_seq, rest.count, rest.body
        return True
