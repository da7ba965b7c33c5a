"""bus.wire.runs: samples that a queue keeps, drops and gives out. tests/property tests more, with a model."""

from hypothesis import given
from hypothesis import strategies as st

from bus.wire.framing import FrameReader
from bus.wire.layout import DATA_HEAD, REPLAY
from bus.wire.runs import RUN_COST_BYTES, Account, Run, RunQueue, data_head
from feeding import feed, frame_record
from rows import for_each

RECORD_BYTES = 13  # for a payload of one letter


def held(letters: int) -> int:
    """The charge for a run of `letters` letters."""
    return letters * RECORD_BYTES + RUN_COST_BYTES


def run(
    letters: str, first_seq: int = 1, *, source: int = 9, stamp_ns: int = 100, replay: bool = False
) -> Run:
    """A run with a sample for each letter."""
    body = b"".join(frame_record(letter.encode(), stamp_ns + at) for at, letter in enumerate(letters))
    return Run(0, source, first_seq, len(letters), body, replay)


def malformed(letters: str, first_seq: int = 1, *, claims: int, tail: bytes = b"") -> Run:
    """A run that claims more samples than it holds."""
    good = run(letters, first_seq)
    return Run(0, good.source, first_seq, claims, bytes(good.body) + tail)


def queue(depth: int = 0, limit: int = 1 << 30) -> RunQueue:
    return RunQueue(depth, Account(limit), endpoint=4)


def frame(waiting: RunQueue) -> tuple[Run, int]:
    """The next frame as its reader receives it, and its flags."""
    head, body = map(bytes, waiting.pop_frame())
    (made,) = feed(FrameReader(max_control_bytes=0, max_data_bytes=1000), head + body)
    assert isinstance(made, Run)
    return made, DATA_HEAD.unpack(head)[2]


def taken(waiting: RunQueue) -> str:
    found = ""
    while waiting.runs:
        found += "".join(bytes(payload).decode() for payload, _ in frame(waiting)[0].records())
    return found


def use_up(waiting: RunQueue, number: int) -> None:
    """Act like a subscription that has decoded `number` samples of the oldest run."""
    waiting.advance(number, waiting.offset + number * RECORD_BYTES)


def replayed(waiting: RunQueue, count: int, after_seq: int = 0) -> list[tuple[int, str]]:
    found = []
    for one in waiting.newest(count, after_seq):
        assert one.is_replay
        letters = "".join(bytes(payload).decode() for payload, _ in one.records())
        assert len(letters) == one.count
        found.append((one.first_seq, letters))
    return found


class TestRecords:
    def test_payloads_and_stamps(self) -> None:
        assert [(bytes(payload), stamp) for payload, stamp in run("ab").records()] == [
            (b"a", 100),
            (b"b", 101),
        ]

    def test_it_stops_where_the_body_is_too_short(self) -> None:
        for tail in (b"", b"\1\0\0\0", frame_record(b"abc", 1)[:-1]):
            assert len(list(malformed("ab", claims=5, tail=tail).records())) == 2

    def test_an_empty_payload(self) -> None:
        assert list(Run(0, 0, 1, 1, frame_record(b"", -5)).records()) == [(memoryview(b""), -5)]


class TestDepth:
    @for_each(("depth", "left"), [(0, "abcdef"), (1, "f"), (4, "cdef"), (6, "abcdef")])
    def test_the_oldest_go(self, depth: int, left: str) -> None:
        waiting = queue(depth)
        replaced = waiting.push(run("abc")) + waiting.push(run("def", 4))
        assert replaced == 6 - len(left)
        assert waiting.count == len(left)
        assert taken(waiting) == left

    def test_a_run_longer_than_the_depth(self) -> None:
        waiting = queue(2)
        assert waiting.push(run("abcde")) == 3
        assert taken(waiting) == "de"

    def test_append_only_says_that_it_is_too_much(self) -> None:
        waiting = queue(2)
        assert not waiting.append(run("ab"))
        assert waiting.append(run("c", 3))
        assert waiting.count == 3
        assert waiting.trim() == 1
        assert waiting.trim() == 0

    def test_replays_do_not_count(self) -> None:
        """The history of each publisher has its own room beside the depth."""
        waiting = queue(2)
        for source in (1, 2):
            assert not waiting.append(run("ab", source=source, replay=True))
        assert waiting.push(run("xy")) == 0
        assert waiting.push(run("z", 3)) == 1
        assert taken(waiting) == "babxyz"

    def test_replays_have_no_room_after_the_queue_was_empty(self) -> None:
        waiting = queue(2)
        waiting.append(run("ab", replay=True))
        waiting.pop_frame()
        assert waiting.push(run("xyz")) == 1


class TestQuota:
    def test_whole_runs_go_oldest_first(self) -> None:
        waiting = queue(limit=held(4))
        assert not waiting.append(run("abc"))
        assert waiting.append(run("def", 4))
        assert waiting.drop_over_quota() == 3
        assert waiting.account.used == waiting.held_bytes == held(3)
        assert taken(waiting) == "def"

    def test_the_newest_are_spared(self) -> None:
        waiting = queue(limit=held(1))
        for at, letters in enumerate(("ab", "cd", "ef")):
            waiting.append(run(letters, 1 + 2 * at))
        assert waiting.drop_over_quota(spare=2) == 2
        assert waiting.drop_over_quota(spare=1) == 2
        assert waiting.drop_over_quota(spare=1) == 0
        assert taken(waiting) == "ef"

    def test_a_run_that_was_used_in_part_counts_whole_until_it_goes(self) -> None:
        waiting = queue(limit=held(3))
        waiting.append(run("abc"))
        use_up(waiting, 1)
        assert waiting.account.used == held(3)
        assert waiting.append(run("d", 4))
        assert waiting.drop_over_quota() == 2
        assert taken(waiting) == "d"

    def test_other_queues_of_the_holder_count(self) -> None:
        account = Account(held(2))
        one, other = RunQueue(0, account), RunQueue(0, account)
        one.append(run("ab"))
        assert other.append(run("c"))
        assert other.drop_over_quota() == 1
        assert account.used == held(2)

    @for_each("empty", ["advance", "pop_frame", "clear", "drop"])
    def test_what_leaves_is_not_charged(self, empty: str) -> None:
        waiting = queue()
        waiting.append(run("abc"))
        match empty:
            case "advance":
                use_up(waiting, 2)
                use_up(waiting, 1)
            case "pop_frame":
                waiting.pop_frame()
            case "clear":
                assert waiting.clear() == 3
            case "drop":
                assert waiting.drop(99) == 3
        assert (waiting.count, waiting.held_bytes, waiting.account.used) == (0, 0, 0)


class TestFrames:
    def test_a_whole_run(self) -> None:
        waiting = queue()
        waiting.append(run("abc", 5))
        made, flags = frame(waiting)
        assert (made.endpoint, made.source, made.first_seq, made.count) == (4, 9, 5, 3)
        assert flags == 0
        assert not waiting.runs

    def test_what_is_left_of_a_run(self) -> None:
        waiting = queue()
        waiting.append(run("abcd", 5))
        use_up(waiting, 1)
        waiting.drop(1)
        made, _ = frame(waiting)
        assert (made.first_seq, made.count) == (7, 2)
        assert [bytes(payload) for payload, _ in made.records()] == [b"c", b"d"]

    def test_a_replay_is_marked(self) -> None:
        waiting = queue()
        waiting.append(run("a", replay=True))
        made, flags = frame(waiting)
        assert made.is_replay
        assert flags == REPLAY

    @for_each("tail", [b"", b"\1", b"\xff" * 12])
    @for_each("dropped", range(6))
    def test_what_is_left_of_a_malformed_run_can_be_read(self, dropped: int, tail: bytes) -> None:
        """A lying publisher must not break the connections of its subscriptions."""
        waiting = queue()
        waiting.append(malformed("ab", claims=6, tail=tail))
        waiting.drop(dropped)
        made, _ = frame(waiting)
        assert made.count == 6 - dropped


def test_the_head_of_a_frame_towards_the_broker() -> None:
    """The head that a publisher packs itself has the same meaning as the head that its queue would send."""
    body = bytes(run("ab", 5).body)
    (made,) = feed(
        FrameReader(max_control_bytes=0, max_data_bytes=1000), data_head(4, 5, 2, len(body)) + body
    )
    assert isinstance(made, Run)
    assert (made.endpoint, made.source, made.first_seq, made.count, made.is_replay) == (4, 0, 5, 2, False)
    assert bytes(made.body) == body


class TestAdvance:
    def test_within_a_run(self) -> None:
        waiting = queue()
        waiting.append(run("abc"))
        waiting.append(run("d", 4))
        use_up(waiting, 2)
        assert waiting.count == 2
        assert taken(waiting) == "cd"

    def test_a_whole_run(self) -> None:
        waiting = queue()
        waiting.append(run("abc"))
        waiting.append(run("d", 4))
        use_up(waiting, 1)
        use_up(waiting, 2)
        assert (waiting.count, waiting.held_bytes) == (1, held(1))
        assert taken(waiting) == "d"


class TestExpiry:
    def old(self, letters: str, stamp_ns: int, lifespan_ns: int) -> Run:
        made = run(letters, stamp_ns=stamp_ns)
        made.lifespan_ns = lifespan_ns
        return made

    @for_each(("now_ns", "dropped"), [(0, 0), (110, 0), (111, 1), (112, 2), (10**6, 3)])
    def test_from_the_head(self, now_ns: int, dropped: int) -> None:
        waiting = queue()
        waiting.append(self.old("abc", 100, 10))
        assert waiting.drop_expired(now_ns) == dropped
        assert taken(waiting) == "abc"[dropped:]

    def test_without_a_lifespan_nothing_expires(self) -> None:
        waiting = queue()
        waiting.append(self.old("abc", 0, 0))
        assert waiting.drop_expired(10**18) == 0

    def test_what_is_behind_a_sample_without_lifespan_stays(self) -> None:
        """The queue checks this sample again when it is at the head, and when it is taken."""
        waiting = queue()
        waiting.append(self.old("a", 0, 0))
        waiting.append(self.old("b", 0, 1))
        assert waiting.drop_expired(10**18) == 0

    def test_a_malformed_run_goes(self) -> None:
        waiting = queue()
        bad = malformed("a", claims=4)
        bad.lifespan_ns = 10**9
        waiting.append(bad)
        assert waiting.drop_expired(0) == 0
        use_up(waiting, 1)
        assert waiting.drop_expired(0) == 3


class TestNewest:
    def history(self) -> RunQueue:
        """Samples b to g with the numbers 2 to 7; the oldest run is used up in part."""
        waiting = queue()
        for letters, first_seq in (("abc", 1), ("d", 4), ("efg", 5)):
            waiting.append(run(letters, first_seq))
        waiting.drop(1)
        return waiting

    @for_each(
        ("count", "after_seq", "expected"),
        [
            (0, 0, [(2, "bc"), (4, "d"), (5, "efg")]),
            (6, 0, [(2, "bc"), (4, "d"), (5, "efg")]),
            (99, 0, [(2, "bc"), (4, "d"), (5, "efg")]),
            (5, 0, [(3, "c"), (4, "d"), (5, "efg")]),
            (3, 0, [(5, "efg")]),
            (1, 0, [(7, "g")]),
            (0, 2, [(3, "c"), (4, "d"), (5, "efg")]),
            (0, 5, [(6, "fg")]),
            (5, 5, [(6, "fg")]),
            (1, 5, [(7, "g")]),
            (0, 7, []),
            (0, 100, []),
        ],
    )
    def test_the_last_ones_in_order(
        self, count: int, after_seq: int, expected: list[tuple[int, str]]
    ) -> None:
        waiting = self.history()
        assert replayed(waiting, count, after_seq) == expected
        assert waiting.count == 6, "the history keeps them"

    def test_an_empty_history(self) -> None:
        assert replayed(queue(), 5) == []

    def test_lifespan_and_source_go_along(self) -> None:
        waiting = queue()
        old = run("ab")
        old.lifespan_ns = 77
        waiting.append(old)
        (again,) = waiting.newest(1, 0)
        assert (again.source, again.lifespan_ns) == (9, 77)


def test_what_is_charged_is_charged_to_the_parent_too() -> None:
    user = Account(100)
    first, second = Account(70, user), Account(70, user)
    first.charge(60)
    second.charge(50)
    assert (first.is_over, second.is_over, user.is_over) == (False, False, True)
    first.charge(-20)
    assert (first.used, user.used, user.is_over) == (40, 90, False)


def test_what_is_left_behind_a_sample() -> None:
    rest = run("abcd", 7).after(8)
    assert (rest.first_seq, rest.count) == (9, 2)
    assert [(bytes(payload), stamp_ns) for payload, stamp_ns in rest.records()] == [(b"c", 102), (b"d", 103)]


class TestExpiryByRuns:
    """A whole run expires in one step, with the same result as sample by sample."""

    def test_of_the_oldest_run_alone(self) -> None:
        waiting = queue()
        for letters in ("ab", "c"):
            old = run(letters, stamp_ns=100)
            old.lifespan_ns = 10
            waiting.append(old)
        assert [waiting.drop_expired_of_head(1000) for _ in range(3)] == [2, 1, 0]

    def test_the_stamps_are_read_once_for_all_queues(self) -> None:
        old = run("ab", stamp_ns=100)
        old.lifespan_ns = 10
        queues = [queue(), queue()]
        for one in queues:
            one.append(old)
        queues[0].drop_expired(10**6)
        assert old.newest_ns == 101
        old.newest_ns = 10**6  # as if the samples were younger, so the second queue looks at each of them
        assert queues[1].drop_expired(10**6) == 2

    @given(
        runs=st.lists(
            st.tuples(st.lists(st.integers(0, 50), min_size=1, max_size=5), st.sampled_from([0, 10, 20])),
            max_size=6,
        ),
        use=st.integers(0, 4),
        now_ns=st.integers(0, 80),
    )
    def test_as_one_by_one(self, runs: list[tuple[list[int], int]], use: int, now_ns: int) -> None:
        def filled() -> RunQueue:
            waiting = queue()
            for stamps, lifespan_ns in runs:
                body = b"".join(frame_record(b"x", stamp) for stamp in stamps)
                waiting.append(Run(1, 1, 1, len(stamps), body, lifespan_ns=lifespan_ns))
            waiting.drop(use)
            return waiting

        one_by_one, expected = filled(), 0
        while one_by_one.runs and (lifespan_ns := one_by_one.runs[0].lifespan_ns):
            stamp_ns = one_by_one.peek_stamp()
            if stamp_ns is not None and stamp_ns + lifespan_ns >= now_ns:
                break
            expected += one_by_one.drop(1)
        gone: list[Run] = []
        waiting = filled()
        assert waiting.drop_expired(now_ns, gone) == expected
        assert (waiting.count, waiting.held_bytes) == (one_by_one.count, one_by_one.held_bytes)
        assert waiting.peek_stamp() == one_by_one.peek_stamp()


class TestThousandsOverQuota:
    def test_all_but_the_newest_go_at_once(self) -> None:
        account = Account(1 << 30)
        waiting, gone = RunQueue(0, account), list[Run]()
        for letter in "abcdefgh":
            waiting.append(run(letter))
        waiting.drop(1)
        runs, account.limit = waiting.runs, 1
        assert waiting.drop_over_quota(gone, spare=1, most=3) == 6
        assert (waiting.count, len(gone), len(waiting.rest)) == (1, 6, 4)
        assert account.used == waiting.held_bytes == held(1)
        assert waiting.runs is runs
        assert waiting.drop_over_quota(gone, most=1) == 1
        assert (waiting.count, account.used, list(waiting.runs)) == (0, 0, [])


def test_queues_that_share_a_run_cut_it_where_their_depths_say() -> None:
    """Each continues from the last cut of another one, if that lies before its own."""
    shared = [run("abcdef"), run("ghijkl", 7)]
    found, steps = [], []
    for depth in (1, 3, 2, 1, 8, 7):
        waiting = queue(depth)
        for one in shared:
            waiting.push(one)
        steps.append(waiting.steps)
        found.append(taken(waiting))
    assert found == ["l", "jkl", "kl", "l", "efghijkl", "fghijkl"]
    assert steps[0] == 5 and steps[2:4] == [1, 1]


def test_a_cut_of_a_run_that_is_too_short() -> None:
    bad = malformed("abc", claims=6)
    for depth in (1, 2, 5):
        waiting = queue(depth)
        waiting.push(bad)
        assert taken(waiting) == ("bc" if depth == 5 else "")
