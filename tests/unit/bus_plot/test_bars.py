"""Numbers as bars of text."""

from bus_plot.bars import bars_text, joined, peaks_text


def test_bars_are_as_high_as_their_part() -> None:
    assert bars_text([0, 1, 50, 100]) == "▁▂▅█"
    assert bars_text([1, 2], top=4) == "▃▅"
    assert bars_text([9], top=4) == "█", "no higher than the highest"


def test_what_is_above_zero_is_seen() -> None:
    assert bars_text([0.0, 0.001, 1000.0]) == "▁▂█"


def test_nothing() -> None:
    assert bars_text([]) == ""
    assert bars_text([0, 0]) == "▁▁"


def test_parts_of_a_minute() -> None:
    assert joined([1.0] * 60, 10) == [6.0] * 10
    assert joined([1, 2, 3, 4, 5], 2) == [3, 12]
    assert joined([], 2) == [0, 0]


def test_peaks_are_seen_and_noise_is_not() -> None:
    assert peaks_text([10, 10.5, 80, 10], 24) == "▁▁█▁"
    assert peaks_text([], 24) == ""
    long = peaks_text([1.0] * 1000 + [900.0] + [1.0] * 1000, 24)
    assert len(long) <= 24 and long.count("█") == 1
