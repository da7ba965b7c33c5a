"""The publishers of one subscription, and what the numbers of their samples tell.

Owns the last number received from each, by whatever route: so no sample is received twice, and a missing one
is noticed, wherever it was lost. Must not know what is done with samples, nor the reasons of losses.
"""

from collections import deque
from collections.abc import Callable

from bus.qos import Durability, QoSProfile
from bus.vocabulary import DropReason, Route
from bus.wire.bounds import MOST_REMEMBERED
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import Matched
from bus.wire.runs import Run

_MOST_GONE = 64
_MOST_GAPS = 64


class PublisherProxy:
    """One publisher: the last number received from it and taken, and what is not yet acknowledged."""

    __slots__ = (
        "acked_seq",
        "clock_ns",
        "gaps",
        "gid",
        "is_new",
        "is_rerouted",
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
        self.shown_gid = gid  # by which users know it
        self.last_seq = last_seq
        self.lifespan_ns = lifespan_ns  # from a stamp of its clock to an end by ours
        self.clock_ns = 0  # what its clock, of another time namespace, is ahead of ours
        self.needs_ack = needs_ack
        self.may_repeat = needs_ack  # whether what we miss may come once more, out of what it keeps
        self.received_seq = 0  # by ring, or from an earlier broker: not even a replay brings these again
        self.is_new = True  # until its first run that is no replay
        # Up to where its history has come, until its first new sample: the rest of the history may follow.
        self.replayed_seq: int | None = None
        # Until the first run by the other route, which shows what was lost between the two:
        self.is_rerouted = False
        self.routed_seq = 0  # once it has gone: the last number that the broker has routed
        # What it published while it was away, as pairs of numbers (the last before, the first after), until a
        # later run comes:
        self.gaps: tuple[tuple[int, int], ...] = ()
        self.taken_seq = self.acked_seq = last_seq
        self.unacked_bytes = 0

    def renew(self, matched: Matched) -> None:
        """The broker says of it anew what a broker can say in another way each time."""
        self.number, self.clock_ns = matched.other, matched.clock_ns
        lifespan_ns = matched.qos.lifespan_ns
        self.lifespan_ns = lifespan_ns and (lifespan_ns - matched.clock_ns or 1)

    def comes_back(self, routed_seq: int, next_seq: int) -> None:
        """The broker has had its samples up to `routed_seq`, and gets those from `next_seq` on."""
        if routed_seq + 1 < next_seq:
            self.gaps = (*self.gaps, (routed_seq, next_seq))[-_MOST_GAPS:]
            self.routed_seq = next_seq - 1
        self.is_new = False  # the broker reports what it did not route to us meanwhile


class SequenceTracker(dict[int, PublisherProxy]):
    """By the number that the broker gave each. `on_lost(reason, count)` hears what is lost between two routes
    or brokers.

    In all methods `reported` is how many samples the present broker has said it dropped for this
    subscription. `last_seqs`: the last number received, by gid, of the publishers of earlier connections.
    """

    def __init__(self, on_lost: Callable[[str, int], None]) -> None:
        super().__init__()
        self._on_lost = on_lost
        self.last_seqs: dict[bytes, int] = {}
        self._gone: deque[int] = deque()
        self.received = 0
        """Samples that came by socket, those that came twice counted once."""
        self.repeated = 0
        """Samples that the present broker sent although they had come before, by a ring say."""
        self.lost_between = 0
        """Samples lost between two routes or two brokers; `on_lost` has heard of them."""
        # Numbers missing in what the present broker sent:
        self._skipped = 0  # the broker has dropped them
        self._perhaps_skipped = 0  # it has, or they went to others only, by their rings
        self._rerouted = 0  # it has, or the ring had given them up before
        self._reported_ahead = 0  # dropped by the last broker, of what would have come next
        self._lost_at_end: dict[bytes, int] = {}  # of publishers that had gone, by gid
        # By gid, how many of `_perhaps_skipped` are missing before the first sample that came, and its
        # number; and the same of the last broker, until the present one says from where on samples were for
        # us:
        self._beginnings: dict[bytes, tuple[int, int]] = {}
        self._unsure: dict[bytes, tuple[int, int]] = {}
        self._unsure_count = 0
        self._reported_besides = 0  # dropped by the last broker, beyond `_skipped`
        # What was dropped and will be found missing, by reason; and how much was found before its reason:
        self._reasons: dict[str, int] = {}
        self._unexplained = 0

    def forget(self, number: int, routed_seq: int = 0) -> None:
        """A publisher has gone. Samples of it may still come, so a number of these publishers are kept.

        The broker has routed its samples up to `routed_seq`, and reports those of them that it drops.
        """
        if (proxy := self.get(number)) is not None:
            proxy.routed_seq = max(proxy.routed_seq, routed_seq)
        self._gone.append(number)
        if len(self._gone) > _MOST_GONE and (oldest := self.pop(self._gone.popleft(), None)) is not None:
            self._remember([oldest])

    def match(
        self, matched: Matched, received_seq: int | None, qos: QoSProfile, *, is_new_broker: bool
    ) -> PublisherProxy:
        """A publisher is matched with a subscription of `qos`, which had its samples up to `received_seq`."""
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
        if received_seq is None:
            if has_history and not is_volatile and matched.next_seq > 1:
                proxy.replayed_seq = 0
            return proxy
        # We were there before: the broker counts all that is missing from now on as dropped. So it is lost,
        # even if the broker has no time to report it.
        proxy.is_new = False
        if matched.next_seq - 1 > received_seq:
            # What was lost with a broker, a lossless publisher sends once more; histories come anyway.
            if is_volatile and not (needs_ack and (has_history or is_new_broker)):
                self.lose_while_away(matched.next_seq - 1 - received_seq, matched.gid)
                proxy.last_seq = matched.next_seq - 1
            else:
                proxy.comes_back(received_seq, matched.next_seq)
        return proxy

    def take_back(self, matched: Matched) -> PublisherProxy | None:
        """A publisher that had gone is there again; what it sent before may still come."""
        for number in self._gone:
            proxy = self.get(number)
            if proxy is not None and proxy.gid == matched.gid:
                proxy.renew(matched)
                proxy.comes_back(proxy.routed_seq, matched.next_seq)
                return proxy
        return None

    def disconnected(self, reported: int, lapped_reason: str) -> None:
        """The broker is gone, and with it the numbers that it gave publishers.

        What it dropped and had no time to report counts as lost with it.
        """
        gone = set(self._gone)
        ends = {
            proxy.gid: proxy.routed_seq - proxy.last_seq
            for proxy in self.values()
            if proxy.number in gone and proxy.routed_seq > proxy.last_seq and not proxy.may_repeat
        }
        # Matched publishers come last, so that the bound forgets departed ones first.
        self._remember(sorted(self.values(), key=lambda proxy: proxy.number not in gone))
        self.clear()
        self._gone.clear()
        self._reasons.clear()
        # Of a publisher that has gone nothing comes next. So what did not come of its end is lost now, and
        # neither explains what is missing of another one nor is it counted once more.
        for gid, count in ends.items():
            self._skipped += count
            self._lost_at_end[gid] = self._lost_at_end.pop(gid, 0) + count
        for gid in [*self._lost_at_end][:-MOST_REMEMBERED]:
            del self._lost_at_end[gid]
        if lapped := self.lapped(reported):
            self.lost_between += lapped
            self._on_lost(lapped_reason, lapped)
        unreported = self._skipped - reported
        self._unexplained = 0
        self._unsure, self._beginnings = self._beginnings, {}
        self._unsure_count, self._perhaps_skipped = self._perhaps_skipped, 0
        self._reported_besides = max(0, -unreported - self._rerouted)
        if unreported > 0:
            self._unexplained = self.lose_while_away(unreported)
        else:
            self._reported_ahead += max(0, self._reported_besides - self._unsure_count)
        self._skipped = self._rerouted = self.repeated = 0

    @property
    def missing(self) -> int:
        """Numbers missing in what the present broker sent, wherever they were lost."""
        return self._skipped + self._rerouted

    def lapped(self, reported: int) -> int:
        """How many of `missing` the broker did not drop: a ring gave them up before its match went by
        socket."""
        return min(self._rerouted, max(0, self.missing - reported))

    def lose_while_away(self, count: int, gid: bytes | None = None) -> int:
        """Count `count` samples, of the publisher `gid`, as lost between two connections, without those that
        the last broker reported, or that were counted as lost when it was lost.

        Returns how many that are.
        """
        if gid is not None:
            count -= min(count, self._lost_at_end.pop(gid, 0))
        lost = count - min(self._reported_ahead, count)
        self._reported_ahead -= count - lost
        if not lost:
            return 0
        self.lost_between += lost
        left = lost
        for reason, known in self._reasons.items():
            self._reasons[reason] = known - min(known, left)
            if some := min(known, left):
                left -= some
                self._on_lost(reason, some)
        if left:
            self._on_lost(DropReason.DISCONNECTED, left)
        return lost

    def note_received(self, gid: bytes, received_seq: int | None) -> None:
        """The last number received of a publisher that is not matched, as a ring tells."""
        if received_seq is not None:
            self.last_seqs[gid] = max(self.last_seqs.get(gid, 0), received_seq)

    def lose(self, count: int) -> None:
        """Count samples of a ring that was never seen here: its publisher grew while the broker was away."""
        self.lost_between += count
        self._on_lost(DropReason.DISCONNECTED, count)

    def learn(self, missed: dict[bytes, tuple[int, int]]) -> None:
        """From where on samples were for us, as in Dropped: that tells how many were skipped before the
        first."""
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
        """What publishers have sent since, or where that begins, as in Dropped: what of it did not come is
        lost."""
        for gid, (first_seq, last_seq) in missed.items():
            # Without a first number the match went by a ring. A subscription that never read that ring, but
            # has an earlier number of the publisher, has missed all after that; without one it can't tell.
            received_seq = max(self.last_seqs.get(gid, 0 if first_seq else last_seq), first_seq - 1)
            self.last_seqs[gid] = max(received_seq, last_seq)
            self.lose_while_away(max(0, last_seq - received_seq), gid)
        self._forget_oldest()

    def explain(self, dropped: dict[str, int]) -> None:
        """By reason, what the last broker had dropped: some of it is found missing only later."""
        for reason, count in dropped.items():
            known = min(self._unexplained, max(0, count))  # found missing already
            self._unexplained -= known
            self._reasons[reason] = max(0, count - known)

    def check_run(self, proxy: PublisherProxy, run: Run) -> bool:
        """A run that is not simply the next one: cut off what came before, count what is missing.

        Returns whether anything is left.
        """
        received_seq = proxy.received_seq if run.is_replay else proxy.last_seq
        if proxy.replayed_seq is not None:
            proxy.replayed_seq = run.first_seq + run.count - 1 if run.is_replay else None
        if run.first_seq <= received_seq and not self._cut_repeated(run, received_seq):
            return False
        missing = max(0, run.first_seq - proxy.last_seq - 1) - self._pass_gaps(proxy, run.first_seq)
        if run.source != proxy.number:
            self._skipped += missing  # the run was sent before the publisher went
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

    def _remember(self, proxies: list[PublisherProxy]) -> None:
        for one in proxies:
            last_seq = one.last_seq if one.replayed_seq is None else one.replayed_seq
            if one.replayed_seq != 0:  # else no history has come: all of it comes next time, as to a new one
                self.last_seqs.pop(one.gid, None)
                self.last_seqs[one.gid] = max(0, min(last_seq, MAX_COUNT))  # a ring may lie
        self._forget_oldest()

    def _forget_oldest(self) -> None:
        for gid in [*self.last_seqs][:-MOST_REMEMBERED]:
            del self.last_seqs[gid]

    def _pass_gaps(self, proxy: PublisherProxy, first_seq: int) -> int:
        """Count what is missing before `first_seq` because no broker got it; returns how many."""
        gone = 0
        for routed_seq, returned_seq in proxy.gaps:
            gone += max(0, min(returned_seq, first_seq) - max(routed_seq, proxy.last_seq) - 1)
        proxy.gaps = tuple(gap for gap in proxy.gaps if first_seq < gap[1])
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
