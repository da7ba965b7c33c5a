"""Serials: new ones, old ones, and those of a peer that has started again."""

from bus_bridge.rtps.serials import Serial, Serials
from rows import for_each

NEW, OLD, RESTARTED = Serial.NEW, Serial.OLD, Serial.RESTARTED
S = 1_000_000_000


@for_each(
    ("serials", "judged"),
    [
        ([0, 1, 5], [NEW, NEW, NEW]),
        ([1, 1, 1], [NEW, OLD, OLD]),
        ([2**32 - 1, 0, 2**32 - 1], [NEW, NEW, OLD]),
        ([9, 7, 10, 8], [NEW, OLD, NEW, OLD]),
        ([9, 7, 7, 6], [NEW, OLD, OLD, OLD]),
        ([9, 1, 2, 3, 1], [NEW, OLD, RESTARTED, NEW, OLD]),
        ([9, 8, 9, 9], [NEW, OLD, OLD, OLD]),
        ([9, 1, 9, 2], [NEW, OLD, OLD, RESTARTED]),
    ],
)
def test_judgments(serials: list[int], judged: list[Serial]) -> None:
    seen = Serials()
    assert [seen.judge(one, S * at) for at, one in enumerate(serials)] == judged


@for_each("serials", [[10, 11, 12, 10, 11, 12], [12, 10, 11], [5, 6, 4, 5, 3, 4]])
def test_repeated_and_late_messages_are_no_restart(serials: list[int]) -> None:
    seen = Serials()
    assert RESTARTED not in [seen.judge(one, S + at) for at, one in enumerate(serials)]
