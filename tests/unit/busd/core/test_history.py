"""Samples in few runs: the history returns the same samples as a queue of single runs."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.wire.layout import RUN_BYTES
from bus.wire.runs import Account, Run, RunQueue
from busd.core.history import GatheredRuns, PublisherHistory
from feeding import frame_record

LARGE = 1 << 30


def run(first_seq: int, count: int = 1, *, size: int = 1, stamp_ns: int = 0, lifespan_ns: int = 0) -> Run:
    payloads = [f"{first_seq + at:0{size}}".encode() for at in range(count)]
    body = b"".join(frame_record(payload, stamp_ns) for payload in payloads)
    return Run(0, 7, first_seq, count, body, lifespan_ns=lifespan_ns)


def seqs(runs: Any) -> list[int]:
    return [int(bytes(payload)[-9:]) for one in runs for payload, _ in one.records()]


class TestGathering:
    def test_short_ones_become_one(self) -> None:
        kept = GatheredRuns(0, Account(LARGE))
        for seq in range(1, 101):
            assert not kept.append(run(seq))
        assert len(kept.runs) == 1
        assert (kept.count, kept.account.used) == (100, kept.held_bytes)
        assert seqs(kept.runs) == list(range(1, 101))

    def test_no_run_outgrows_a_frame(self) -> None:
        kept = GatheredRuns(0, Account(LARGE))
        for seq in range(1, 101):
            kept.append(run(seq, size=5_000))
        assert max(len(one.body) for one in kept.runs) <= RUN_BYTES
        assert len(kept.runs) == 8
        assert seqs(kept.runs) == list(range(1, 101))

    @pytest.mark.parametrize(
        "other",
        [run(2, size=40_000), run(5), run(2, 33), Run(0, 7, 2, 1, frame_record(b"2", 0) + b"\xff" * 9)],
        ids=["long", "behind a gap", "of many samples", "malformed"],
    )
    def test_what_stays_alone(self, other: Run) -> None:
        kept = GatheredRuns(0, Account(LARGE))
        kept.append(run(1))
        kept.append(other)
        assert [one.first_seq for one in kept.runs] == [1, other.first_seq]

    def test_what_others_hold_grows_no_more(self) -> None:
        kept = GatheredRuns(0, Account(LARGE))
        kept.append(run(1))
        kept.close()
        held = kept.runs[0]
        kept.append(run(2))
        assert (held.count, seqs([held])) == (1, [1])

    def test_of_a_small_account_little_is_gathered(self) -> None:
        """Otherwise a full account would lose too much at a time."""
        kept = GatheredRuns(0, Account(LARGE, Account(6_400)))
        for seq in range(1, 11):
            kept.append(run(seq))
        assert max(len(one.body) for one in kept.runs) <= 100

    def test_what_may_be_held_holds_for_a_run_that_grows(self) -> None:
        account = Account(LARGE)
        kept = GatheredRuns(0, account)
        kept.append(run(1))
        account.limit = account.used
        account.parent = Account(LARGE)
        assert kept.append(run(2))


def test_a_late_joiner_is_not_disturbed_by_what_comes_later() -> None:
    kept = PublisherHistory(0, Account(LARGE))
    kept.append(run(1))
    replayed = list(kept.newest(0, 0))
    kept.append(run(2))
    assert seqs(replayed) == [1]
    assert seqs(kept.newest(0, 0)) == [1, 2]


@st.composite
def _deeds(draw: st.DrawFn) -> list[tuple[str, int, int]]:
    deed = st.sampled_from(["append", "append", "append", "gap", "newest", "expire", "trim", "drop"])
    return draw(st.lists(st.tuples(deed, st.integers(1, 40), st.sampled_from([1, 30, 20_000])), max_size=40))


@given(deeds=_deeds(), depth=st.sampled_from([0, 1, 5, 100]))
def test_as_a_queue_that_gathers_nothing(deeds: list[tuple[str, int, int]], depth: int) -> None:
    kept, plain = PublisherHistory(depth, Account(LARGE)), RunQueue(depth, Account(LARGE))
    seq, now_ns = 1, 1000
    for deed, number, size in deeds:
        match deed:
            case "append":
                for one in (kept, plain):
                    one.append(run(seq, number, size=size, stamp_ns=now_ns, lifespan_ns=100))
                seq, now_ns = seq + number, now_ns + 10
            case "gap":
                seq += number
            case "newest":
                assert seqs(kept.newest(number, seq - 20)) == seqs(plain.newest(number, seq - 20))
            case "expire":
                now_ns += number
                assert kept.drop_expired(now_ns) == plain.drop_expired(now_ns)
            case "trim":
                assert kept.trim() == plain.trim()
            case "drop":
                assert kept.drop(number) == plain.drop(number)
        assert kept.count == plain.count
    assert seqs(kept.newest(0, 0)) == seqs(plain.newest(0, 0))
    kept.clear()
    assert kept.account.used == 0
