"""bus.shm._core: for any order of writes, a sleeping process without a pending doorbell has received all."""

import select
from functools import partial
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus import shm
from bus.shm import segments
from effort import examples

pytestmark = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())

RINGS = 40
"""Rings of each process; too many for a check of all at each turn."""
PREPARED = 30
"""The number of readers with a callback; for the others, the owner takes."""

NUMBERS = st.integers(0, 3) | st.integers(0, RINGS - 1)
RARE = st.sampled_from(
    (
        "take",
        "report",
        "match again",
        "second gate",
        "go on in another ring",
        "write in the next call",
        "take in the next call",
        "raise in the next call",
    )
)
ACTIONS = st.lists(
    st.one_of(
        *[st.tuples(st.just("write"), NUMBERS)] * 6,
        *[st.tuples(st.just("rung"), st.just(0))] * 4,
        *[st.tuples(RARE, NUMBERS)] * 2,
    ),
    max_size=60,
)


class Process:
    """Reads rings of two processes; at a doorbell it does the same as `bus.link.shm_context`."""

    def __init__(self) -> None:
        self.core = shm.native
        self.segment, memory = segments.make_readers(4 * RINGS)
        self.doorbell = segments.make_doorbell()
        self.readers = self.core.Readers(memory, self.doorbell.number)
        self.bells = [
            self.core.Bell(segments.map_readers(self.segment), self.doorbell.number) for _ in range(2)
        ]
        self.poll = select.poll()
        self.poll.register(self.doorbell.number, select.POLLIN)
        self.slots = list(range(4 * RINGS))
        self.rings, self.writers, self.all_readers = [], [], []
        self.written, self.heard = [0] * RINGS, [0] * RINGS
        self.later: list[tuple[str, int]] = []
        self.is_asleep = False
        self.gates = list(range(RINGS))
        for number in range(RINGS):
            ring, mapping = segments.make_ring(8192, 128, 1)
            self.rings.append(ring)
            self.writers.append(self.core.Writer(mapping, 1))
            reader: shm.native.Reader[str] = self.core.Reader(self.readers, number, 0, tells_cursor=False)
            self.all_readers.append(reader)
            if number < PREPARED:
                reader.is_report_due = True
                reader.prepare(partial(self.hear, number), bytes, print, (), int)
            self.match(number)
        self.sleep()

    def close(self) -> None:
        self.all_readers.clear()
        for descriptor in (*self.rings, self.segment, self.doorbell):
            descriptor.close()

    def match(self, number: int) -> None:
        slot = self.slots.pop(0)
        self.all_readers[number].attach(
            "talker", segments.map_ring(self.rings[number]), slot, start=self.writers[number].latest + 1
        )
        bell = self.bells[number % 2]
        self.writers[number].add_gate(number, bell, slot, is_lossless=False)
        self.heard[number] = self.written[number]

    def hear(self, number: int, _: bytes) -> None:
        self.heard[number] += 1
        for what, at in self.later[:1]:
            self.later.clear()
            self.do(what, at)

    def take(self, number: int) -> None:
        self.heard[number] += len(self.all_readers[number].messages(1000, bytes))

    def do(self, what: str, number: int) -> None:
        if what == "write":
            assert self.writers[number].write(b"x") is not False
            self.written[number] += 1
        elif what == "take":
            self.take(number)
        elif what == "report":  # the next message is noted
            self.all_readers[number].is_report_due = False
        elif what == "raise":
            raise KeyboardInterrupt
        elif what == "match again":
            self.all_readers[number].detach("talker")
            self.writers[number].remove_gate(number)
            self.match(number)
        elif what == "second gate":  # of an earlier match, before its end is known
            self.gates.append(len(self.gates))
            self.writers[number].add_gate(
                self.gates[-1], self.bells[number % 2], 4 * RINGS - 1 - number, is_lossless=False
            )
        elif what == "go on in another ring":
            ring, mapping = segments.make_ring(16384, 256, self.writers[number].carry_from(1 << 30))
            self.writers[number].move(mapping)
            self.all_readers[number].extend("talker", segments.map_ring(ring))
            self.rings[number].close()
            self.rings[number] = ring
        else:
            self.later.append((what.removesuffix(" in the next call"), number))

    def rung(self) -> None:
        try:
            owners = self.readers.deliver(True)
        except KeyboardInterrupt:
            self.is_asleep = False
            assert self.is_rung()
            return
        self.is_asleep = owners is None
        for owner in owners or ():
            self.take(owner)
        if owners is not None:
            self.sleep()

    def sleep(self) -> None:
        while owners := self.readers.sleep():
            for owner in owners:
                self.take(owner)
        self.is_asleep = True

    def is_rung(self) -> bool:
        return bool(self.poll.poll(0))


@settings(max_examples=examples(300), deadline=None)
@given(actions=ACTIONS)
def test_who_sleeps_and_is_not_rung_has_had_everything(actions: list[tuple[str, int]]) -> None:
    process: Any = Process()
    try:
        for what, number in actions:
            if what == "rung":
                if process.is_rung():
                    process.rung()
            else:
                process.do(what, number)
            if process.is_asleep and not process.is_rung():
                assert process.heard == process.written, (what, number)
        while process.is_rung():
            process.rung()
        assert process.heard == process.written
    finally:
        process.close()
