"""Runs in C against runs in Python: equal bytes and equal results for any input."""

import struct
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from bus import shm
from bus.delivery.open_run import OpenRun, PythonRun
from bus.delivery.receiver import Receiver
from bus.delivery.sequence import PublisherProxy
from bus.shm import has_core
from bus.wire.layout import MAX_COUNT
from bus.wire.runs import Run
from feeding import frame_record

pytestmark = pytest.mark.skipif(not has_core(), reason="the native core was not built")

STAMPS = st.integers(1, MAX_COUNT)
SHORT = st.binary(max_size=40)
LONG = st.builds(lambda byte, size: byte * size, st.binary(min_size=1, max_size=1), st.integers(4000, 9000))
PAYLOADS = st.one_of(SHORT, SHORT, SHORT, LONG).flatmap(
    lambda payload: st.sampled_from([payload, bytearray(payload), memoryview(payload)])
)


class BothRuns(RuleBasedStateMachine):
    """One `OpenRun` of each kind, with the same calls."""

    def __init__(self) -> None:
        super().__init__()
        self.runs: tuple[OpenRun, OpenRun] = (PythonRun(), shm.native.OpenRun())

    def alike(self, ask: Callable[[OpenRun], Any]) -> Any:
        """The results of both, or their exceptions."""
        answers = []
        for run in self.runs:
            try:
                answers.append(ask(run))
            except ValueError:
                answers.append(ValueError)
        assert answers[0] == answers[1]
        return answers[0]

    @rule(payload=PAYLOADS, stamp_ns=STAMPS, budget=st.one_of(st.just(0), st.integers(0, 70_000)))
    def begin(self, payload: Any, stamp_ns: int, budget: int) -> None:
        if self.alike(lambda run: run.begin(payload, stamp_ns)) is None:
            for run in self.runs:
                run.budget = budget

    @rule(payloads=st.lists(PAYLOADS, max_size=40), stamp_ns=STAMPS)
    def add(self, payloads: list[Any], stamp_ns: int) -> None:
        for payload in payloads:
            self.alike(lambda run, payload=payload: run.add(payload, stamp_ns))  # type: ignore[misc]

    @rule(most=st.integers(0, 50))
    def bound(self, most: int) -> None:
        for run in self.runs:
            run.most = most

    @rule(
        endpoint=st.integers(0, (1 << 32) - 1), first_seq=st.integers(1, MAX_COUNT), flags=st.integers(0, 3)
    )
    def end(self, endpoint: int, first_seq: int, flags: int) -> None:
        if self.runs[0].samples:
            frame = self.alike(lambda run: run.end(endpoint, first_seq, flags))
            assert struct.unpack_from("<I", frame)[0] == len(frame) - 4

    @rule()
    def forget(self) -> None:
        self.alike(lambda run: run.forget())

    @invariant()
    def is_alike(self) -> None:
        self.alike(lambda run: (run.samples, run.size, run.budget))


TestBothRuns = BothRuns.TestCase


def decode(payload: Any) -> bytes:
    """Raises for some payloads."""
    content = bytes(payload)
    if content.startswith(b"!"):
        raise ValueError("no message")
    return content


class Box:
    """A receiver with one lossless publisher, and all its reports."""

    def __init__(self, *, is_native: bool, depth: int) -> None:
        self.told: list[Any] = []
        self.receiver: Receiver[bytes] = Receiver(
            decode,
            depth,
            is_lossless=True,
            on_drop=lambda reason, count: self.told.append((reason, count)),
            on_reject=lambda size, error: self.told.append((size, str(error))),
            on_taken=lambda source: None,
        )
        self.receiver._has_core = is_native
        self.receiver.tracker[1] = PublisherProxy(1, b"1" * 16, 0, 0, needs_ack=True)

    def put(self, first_seq: int, count: int, body: Any) -> None:
        run = Run(1, 1, first_seq, count, body)
        if self.receiver.put(run):
            self.receiver.trim()

    def arrive(self, first_seq: int, count: int, body: Any, *, is_alone: bool) -> list[bytes]:
        """Put and take a run, or use the fast path if possible."""
        if is_alone and (got := self.receiver.take_lone(Run(1, 1, first_seq, count, body))):
            return [got[0]]
        self.put(first_seq, count, body)
        return self.take(1, by_messages=True)

    def take(self, limit: int, *, by_messages: bool) -> list[bytes]:
        """Take all, as the dispatcher does."""
        got: list[bytes] = []
        while True:
            if by_messages and (messages := self.receiver.take_messages(limit)):
                got += messages
            elif taken := self.receiver.take(limit):
                got.append(taken[0])
                if not by_messages:
                    self.told.append((taken[1], taken[2], taken[4]))
            else:
                return got

    @property
    def counts(self) -> Any:
        receiver = self.receiver
        source = receiver.tracker[1]
        return (
            (
                receiver.delivered,
                receiver.bytes,
                receiver.queued,
                receiver.dropped,
                receiver._queue.held_bytes,
            ),
            (source.last_seq, source.taken_seq, source.unacked_bytes),
            (receiver.tracker.received, receiver.tracker.missing),
            self.told,
        )


GOOD = st.lists(
    st.tuples(st.one_of(SHORT, LONG, st.just(b"!")), STAMPS).map(lambda pair: frame_record(*pair)), min_size=1
)
BODIES = st.one_of(
    GOOD.map(lambda records: (len(records), b"".join(records))),
    st.tuples(st.integers(1, 100), st.binary(max_size=100)),  # hostile
    st.tuples(GOOD, st.integers(0, 30), st.integers(0, 30)).map(  # cut off, or with too high a count
        lambda cut: (len(cut[0]) + cut[1], b"".join(cut[0])[: -cut[2] or None])
    ),
)


@given(
    runs=st.lists(BODIES, min_size=1, max_size=5),
    limits=st.lists(st.integers(1, 70), min_size=1, max_size=5),
    depth=st.sampled_from([0, 1, 3, 100]),
    as_view=st.booleans(),
    by_messages=st.booleans(),
)
def test_both_take_a_run_apart_alike(
    runs: list[tuple[int, bytes]], limits: list[int], depth: int, as_view: bool, by_messages: bool
) -> None:
    boxes = Box(is_native=True, depth=depth), Box(is_native=False, depth=depth)
    next_seq = 1
    for index, (count, body) in enumerate(runs):
        got = []
        for box in boxes:
            box.put(next_seq, count, memoryview(body) if as_view else body)
            got.append(box.take(limits[index % len(limits)], by_messages=by_messages))
        assert got[0] == got[1]
        next_seq += count
    assert boxes[0].counts == boxes[1].counts


@given(
    runs=st.lists(st.tuples(st.integers(-2, 3), BODIES), min_size=1, max_size=8),
    depth=st.sampled_from([0, 1, 3, 100]),
    lifespan_ns=st.sampled_from([0, 0, 0, 1]),
    is_met=st.booleans(),
)
def test_a_run_that_comes_alone_is_as_any(
    runs: list[tuple[int, tuple[int, bytes]]], depth: int, lifespan_ns: int, is_met: bool
) -> None:
    """Also after gaps and repetitions, and with a broken run."""
    boxes = Box(is_native=True, depth=depth), Box(is_native=False, depth=depth)
    for box in boxes:
        source = box.receiver.tracker[1]
        source.lifespan_ns, source.is_new = lifespan_ns, not is_met
    next_seq = 1
    for gap, (count, body) in runs:
        first_seq = max(1, next_seq + gap)
        got = [box.arrive(first_seq, count, body, is_alone=box is boxes[0]) for box in boxes]
        assert got[0] == got[1]
        next_seq = first_seq + count
    assert boxes[0].counts == boxes[1].counts


@given(
    body=st.binary(max_size=200),
    offset=st.one_of(st.integers(0, 250), st.integers(0, (1 << 64) - 1)),
    number=st.one_of(st.integers(0, 30), st.integers(0, (1 << 64) - 1)),
)
def test_nothing_is_read_behind_the_end(body: bytes, offset: int, number: int) -> None:
    found = shm.native.run_messages(body, offset, number, bytes)
    if found is not None:
        messages, end = found
        assert len(messages) == number
        if number:
            assert end == offset + sum(12 + len(message) for message in messages) <= len(body)
