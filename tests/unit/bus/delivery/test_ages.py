"""bus.delivery.ages: the ages of messages when a program takes them."""

from bus.delivery.ages import AT_ONCE, EACH, Ages
from bus.wire.layout import MAX_COUNT


def test_what_was_counted_since_the_last_report() -> None:
    ages = Ages()
    ages.add(30)
    ages.add(50)
    ages.add_all(2, 20, 15, (2,))
    assert ages.window == (4, 100, 50)
    assert ages.report() == (4, 100, 50, (4,))
    assert ages.report() == (0, 0, 0, ())
    assert ages.window == (4, 100, 50)
    ages.add(1600)
    assert ages.window == (1, 1600, 1600)
    assert ages.report() == (1, 1600, 1600, (0, 0, 1))


def test_all_are_looked_at_where_they_are_few_and_else_one_in_some() -> None:
    ages = Ages()
    assert [ages.add(1) for _ in range(AT_ONCE + 2)] == [1] * (AT_ONCE - 1) + [EACH] * 3
    ages.report()
    assert ages.add(1) == 1


def test_a_stamp_that_lies_makes_no_absurd_sum() -> None:
    ages = Ages()
    ages.add(-5)
    ages.add(MAX_COUNT)
    assert ages.window == (2, 0, 0)
    ages.add(MAX_COUNT - 1)
    ages.add(1)
    assert ages.window == (4, MAX_COUNT - 1, MAX_COUNT - 1)
    ages.add_all(2, 7, 4, (2,))
    assert ages.window == (6, MAX_COUNT, MAX_COUNT - 1)
