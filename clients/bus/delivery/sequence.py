"""The publishers that one subscription hears, and what the numbers of their samples tell.

Owns up to which number each was heard, by whatever route; so that nothing is received twice, and what is
missing is known, whoever lost it. Must not know what is done with samples, nor who counts why they were lost.
"""

from collections import deque
from collections.abc import Callable

from bus.qos import Durability, QoSProfile
from bus.wire.bounds import MOST_REMEMBERED
from bus.wire.layout import MAX_COUNT
from bus.wire.messages import Matched
from bus.wire.runs import Run

_MOST_GONE = 64
_MOST_GAPS = 64


class PublisherProxy:
    """A publisher that is heard: the last number received and taken, and what is not yet acknowledged."""

    __slots__ = (
        "acked_seq",
        "gaps",
        "gid",
        "is_new",
        "is_rerouted",
        "known_seq",
        "last_seq",
        "lifespan_ns",
        "needs_ack",
        "number",
        "replayed_seq",
        "routed_seq",
        "taken_seq",
        "unacked_bytes",
    )

    def __init__(self, number: int, gid: bytes, last_seq: int, lifespan_ns: int, *, needs_ack: bool) -> None:
        self.number = number
        self.gid = gid
        self.last_seq = last_seq
        self.lifespan_ns = lifespan_ns
        self.needs_ack = needs_ack
        self.known_seq = 0  # read from the ring, before the match went by socket: also no replay of these
        self.is_new = True  # until its first run that is no replay
        # Up to where its history has come, as long as nothing else has: that is still to be expected then.
        self.replayed_seq: int | None = None
        # Until the first run by another route, which shows what was lost between them:
        self.is_rerouted = False
        self.routed_seq = 0  # as it has gone: the last number that the broker has routed
        # What it published while it was away: the numbers before and behind it, until a run from there comes.
        self.gaps: tuple[tuple[int, int], ...] = ()
        self.taken_seq = self.acked_seq = last_seq
        self.unacked_bytes = 0

    def comes_back(self, routed_seq: int, next_seq: int) -> None:
        """A broker had got its samples up to `routed_seq`, and gets those from `next_seq` on."""
        if routed_seq + 1 < next_seq:
            self.gaps = (*self.gaps, (routed_seq, next_seq))[-_MOST_GAPS:]
            self.routed_seq = next_seq - 1
        self.is_new = False  # of what went to others meanwhile, the broker says that it is lost


class SequenceTracker(dict[int, PublisherProxy]):
    """By the number that the broker gave each. `on_lost(reason, count)` hears what is lost between two ways.

    `told` is everywhere how many samples the present broker has said it dropped for this subscription.
    `last_seqs` are, by gid, those that were heard in earlier connections, and up to where.
    """

    def __init__(self, on_lost: Callable[[str, int], None]) -> None:
        super().__init__()
        self._on_lost = on_lost
        self.last_seqs: dict[bytes, int] = {}
        self._gone: deque[int] = deque()
        self.received = 0
        """Samples that came by socket, without those that were known."""
        self.known = 0
        """Samples that the present broker sent, and that had come before by another way."""
        self.lost_between = 0
        """Samples lost between two routes or two brokers, of which `on_lost` was told."""
        # Numbers missing in what the present broker sent:
        self._skipped = 0  # it has dropped them
        self._perhaps_skipped = 0  # or they went by another route, to others
        self._rerouted = 0  # or the ring had given them up before
        self._told_ahead = 0  # what the broker that left had dropped of what would have come next
        # By gid, how many of these are missing before the first that came, and its number; the same of the
        # broker that left, until it says from where on samples were for us:
        self._beginnings: dict[bytes, tuple[int, int]] = {}
        self._unsure: dict[bytes, tuple[int, int]] = {}
        self._unsure_count = 0
        self._told_besides = 0  # by the broker that left: more than it had surely skipped
        # What was dropped of what will be found lost, by reason; and how much has been without a reason:
        self._reasons: dict[str, int] = {}
        self._unexplained = 0

    def forget(self, number: int, routed_seq: int = 0) -> None:
        """A publisher has gone; samples of it may still come, so the last ones are remembered for a while.

        The broker has routed those up to `routed_seq`: which of them do not come, it says.
        """
        if (source := self.get(number)) is not None:
            source.routed_seq = max(source.routed_seq, routed_seq)
        self._gone.append(number)
        if len(self._gone) > _MOST_GONE and (oldest := self.pop(self._gone.popleft(), None)) is not None:
            self._remember([oldest])

    def meet(
        self, matched: Matched, known_seq: int | None, qos: QoSProfile, *, is_new_broker: bool
    ) -> PublisherProxy:
        """A publisher is matched, as a subscription of `qos` asks. `known_seq`: up to where it was heard."""
        last_seq = matched.next_seq - 1 if known_seq is None else known_seq
        needs_ack = qos.is_lossless and matched.qos.is_lossless
        source = PublisherProxy(
            matched.other, matched.gid, last_seq, matched.qos.lifespan_ns, needs_ack=needs_ack
        )
        source.known_seq = known_seq or 0
        if matched.route != "socket":
            return source
        has_history = matched.qos.durability is Durability.TRANSIENT_LOCAL
        is_volatile = qos.durability is Durability.VOLATILE
        if known_seq is None:
            if has_history and not is_volatile and matched.next_seq > 1:
                source.replayed_seq = 0
        elif matched.next_seq - 1 > known_seq:
            # What a broker took with it, a lossless publisher sends once more; histories come anyway.
            if is_volatile and not (needs_ack and (has_history or is_new_broker)):
                self.lose_while_away(matched.next_seq - 1 - known_seq)
                source.last_seq = matched.next_seq - 1
            else:
                source.comes_back(known_seq, matched.next_seq)
        return source

    def take_back(self, matched: Matched) -> PublisherProxy | None:
        """A publisher that had gone is there again; what it sent before may still come."""
        for number in self._gone:
            source = self.get(number)
            if source is not None and source.gid == matched.gid:
                source.number = matched.other
                source.lifespan_ns = matched.qos.lifespan_ns
                source.comes_back(source.routed_seq, matched.next_seq)
                return source
        return None

    def disconnected(self, told: int, lapped_reason: str) -> None:
        """The broker is gone, and with it the numbers of publishers.

        What it had no time to tell is lost with it.
        """
        gone = set(self._gone)
        # Matched publishers come last, so that the bound forgets departed ones first.
        self._remember(sorted(self.values(), key=lambda source: source.number not in gone))
        self.clear()
        self._gone.clear()
        self._reasons.clear()
        if lapped := self.lapped(told):
            self.lost_between += lapped
            self._on_lost(lapped_reason, lapped)
        untold = self._skipped - told
        self._unexplained = 0
        self._unsure, self._beginnings = self._beginnings, {}
        self._unsure_count, self._perhaps_skipped = self._perhaps_skipped, 0
        self._told_besides = max(0, -untold - self._rerouted)
        if untold > 0:
            self._unexplained = self.lose_while_away(untold)
        else:
            self._told_ahead += max(0, self._told_besides - self._unsure_count)
        self._skipped = self._rerouted = self.known = 0

    @property
    def missing(self) -> int:
        """Numbers missing in what the present broker sent, whoever lost them."""
        return self._skipped + self._rerouted

    def lapped(self, told: int) -> int:
        """How many of `missing` a ring had given up before its match went by socket, and not the broker."""
        return min(self._rerouted, max(0, self.missing - told))

    def lose_while_away(self, count: int) -> int:
        """Count what was lost between two connections, but for what was told in the one before.

        Returns how much that is.
        """
        lost = count - min(self._told_ahead, count)
        self._told_ahead -= count - lost
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
            self._on_lost("disconnected", left)
        return lost

    def hear(self, gid: bytes, known_seq: int | None) -> None:
        """Of a publisher that is not matched, it is known by another way up to where it was heard."""
        if known_seq is not None:
            self.last_seqs[gid] = max(self.last_seqs.get(gid, 0), known_seq)

    def lose(self, count: int) -> None:
        """Count samples of a ring that was never seen here: its publisher went on in it meanwhile."""
        self.lost_between += count
        self._on_lost("disconnected", count)

    def learn(self, missed: dict[bytes, tuple[int, int]]) -> None:
        """From where on samples were for us, as in Dropped: so what was skipped before the first one."""
        skipped = 0
        ahead = max(0, self._told_besides - self._unsure_count)
        for gid, (first_seq, _) in missed.items():
            if first_seq and gid in self._unsure:
                count, came_seq = self._unsure.pop(gid)
                self._unsure_count -= count
                skipped += min(count, max(0, came_seq - first_seq))
        untold = skipped - self._told_besides
        self._told_besides = max(0, -untold)
        self._told_ahead += max(0, self._told_besides - self._unsure_count) - ahead
        if untold > 0:
            self.lose_while_away(untold)

    def miss(self, missed: dict[bytes, tuple[int, int]]) -> None:
        """What publishers have sent since, or from where on that was to come; as in Dropped."""
        for gid, (first_seq, last_seq) in missed.items():
            # No first number: the match went by a ring. Who never read that ring and knows an earlier number
            # has missed what lies behind it; who knows none can't tell what was for it.
            known_seq = max(self.last_seqs.get(gid, 0 if first_seq else last_seq), first_seq - 1)
            self.last_seqs[gid] = max(known_seq, last_seq)
            self.lose_while_away(max(0, last_seq - known_seq))
        self._forget_oldest()

    def explain(self, dropped: dict[str, int]) -> None:
        """The broker had dropped these, by reason, of what will be found lost."""
        for reason, count in dropped.items():
            known = min(self._unexplained, max(0, count))  # it was found already
            self._unexplained -= known
            self._reasons[reason] = max(0, count - known)

    def look_at(self, source: PublisherProxy, run: Run) -> bool:
        """A run that is not simply the next: cut off what is known, note what is missing.

        Returns whether anything is left.
        """
        known_seq = source.known_seq if run.is_replay else source.last_seq
        if source.replayed_seq is not None:
            source.replayed_seq = run.first_seq + run.count - 1 if run.is_replay else None
        if run.first_seq <= known_seq and not self._skip_known(run, known_seq):
            return False
        missing = max(0, run.first_seq - source.last_seq - 1) - self._pass_gaps(source, run.first_seq)
        if run.source != source.number:
            self._skipped += missing  # it was sent before the publisher went
            return True
        if source.is_rerouted:
            self._rerouted += missing
        elif source.is_new:
            self._perhaps_skipped += missing
            self._beginnings[source.gid] = missing, run.first_seq
            if len(self._beginnings) > MOST_REMEMBERED:
                del self._beginnings[next(iter(self._beginnings))]
        else:
            self._skipped += missing
        source.is_rerouted = False
        source.is_new &= run.is_replay
        return True

    def _remember(self, sources: list[PublisherProxy]) -> None:
        for one in sources:
            last_seq = one.last_seq if one.replayed_seq is None else one.replayed_seq
            if one.replayed_seq != 0:  # else nothing of its history has come: it comes as to a new one
                self.last_seqs.pop(one.gid, None)
                self.last_seqs[one.gid] = max(0, min(last_seq, MAX_COUNT))  # a ring may lie
        self._forget_oldest()

    def _forget_oldest(self) -> None:
        for gid in [*self.last_seqs][:-MOST_REMEMBERED]:
            del self.last_seqs[gid]

    def _pass_gaps(self, source: PublisherProxy, first_seq: int) -> int:
        """Count what is missing before `first_seq` because no broker got it; returns how many."""
        gone = 0
        for routed_seq, returned_seq in source.gaps:
            gone += max(0, min(returned_seq, first_seq) - max(routed_seq, source.last_seq) - 1)
        source.gaps = tuple(gap for gap in source.gaps if first_seq < gap[1])
        self.lose_while_away(gone)
        return gone

    def _skip_known(self, run: Run, known_seq: int) -> bool:
        known = known_seq + 1 - run.first_seq
        self.known += min(known, run.count)
        if known >= run.count:
            return False
        rest = run.after(known_seq)
        run.first_seq, run.count, run.body = rest.first_seq, rest.count, rest.body
        return True
