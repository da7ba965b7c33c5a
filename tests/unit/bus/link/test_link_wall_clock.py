"""bus.link.link: how far the wall clock is ahead, with pauses between the readings of both clocks."""

import pytest

from bus.link import link
from rows import for_each

AHEAD_NS = 1_000_000


def read(monkeypatch: pytest.MonkeyPatch, *times_ns: int, known_ns: int | None = None) -> int:
    """The offset, if the clocks are read in turn at these times of the monotonic clock."""
    clock = iter(times_ns)
    monkeypatch.setattr(link, "monotonic_ns", lambda: next(clock))
    monkeypatch.setattr(link, "time_ns", lambda: next(clock) + AHEAD_NS)
    return link._wall_offset_ns(known_ns)


def test_the_first_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    assert read(monkeypatch, 100, 150, 200) == AHEAD_NS


@for_each("times_ns", [(100, 150, 9000), (100, 8950, 9000), (100, 100, 100)])
def test_a_pause_of_the_process_changes_nothing(
    monkeypatch: pytest.MonkeyPatch, times_ns: tuple[int, ...]
) -> None:
    assert read(monkeypatch, *times_ns, known_ns=AHEAD_NS) == AHEAD_NS


@for_each("known_ns", [AHEAD_NS - 51, AHEAD_NS + 51, 0])
def test_a_change_of_the_wall_clock_is_seen(monkeypatch: pytest.MonkeyPatch, known_ns: int) -> None:
    assert read(monkeypatch, 100, 150, 200, known_ns=known_ns) == AHEAD_NS
