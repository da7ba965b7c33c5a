"""Lines about the gaps of a bag."""

from bus_bag.play.gaps import gaps_in, lines
from bus_bag.play.player import Span
from bus_bag.storage import Stretch

S = 1_000_000_000
YEAR = 31_557_600 * S
SPAN = Span(10 * S, 100 * YEAR, True)


def test_each_gap_is_named_with_its_place_and_the_option() -> None:
    gaps = [Stretch(12 * S, 12 * S + 56 * YEAR), Stretch(57 * YEAR, 57 * YEAR + 90 * S)]
    first, second = lines(gaps, SPAN, None)
    assert first == "No messages for 56 years after 2.00 s. To skip such gaps: --skip-gaps 60"
    assert second.startswith("No messages for 90 s after ")
    in_page, _ = lines(gaps, SPAN, None, is_in_page=True)
    assert in_page == "No messages for 56 years after 2.00 s. The bar of the page can seek past it."


def test_many_gaps_are_counted() -> None:
    gaps = [Stretch(hour * 3600 * S, (hour * 3600 + 300) * S) for hour in range(1, 9)]
    *named, last = lines(gaps, SPAN, None)
    assert len(named) == 5 and last == "3 more gaps of more than 60 s"
    assert list(lines(gaps, SPAN, 2 * S)) == ["Skipping 8 gaps of more than 2 s: 40 minutes in total."]
    assert not list(lines([], SPAN, None)) and not list(lines([], SPAN, 1))


def test_only_the_played_part_counts() -> None:
    before, begun, inside, beyond = (Stretch(start * S, (start + 8) * S) for start in (0, 6, 30, 60))
    assert gaps_in([before, begun, inside, beyond], Span(10 * S, 90 * S, False, 65 * S)) == [begun, inside]
    assert list(lines([begun], SPAN, 0)) == ["Skipping 1 gap of more than 0 s: 4 s in total."]
