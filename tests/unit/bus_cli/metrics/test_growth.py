"""bus_cli.metrics.growth: counters that restart."""

from bus_cli.metrics.growth import Growth

ONE, OTHER = ("one",), ("other",)


def test_what_was_counted_since_the_last_time() -> None:
    growth = Growth("all", 10)
    assert growth.take({ONE: {"all": 3, "bad": 1}}) == {ONE: {"all": 3, "bad": 1}}
    assert growth.take({ONE: {"all": 5, "bad": 1, "new": 2}}) == {ONE: {"all": 2, "bad": 0, "new": 2}}


def test_one_whose_leading_counter_has_fallen_began_anew() -> None:
    growth = Growth("all", 10)
    growth.take({ONE: {"all": 3, "bad": 1}})
    assert growth.take({ONE: {"all": 2, "bad": 2}}) == {ONE: {"all": 2, "bad": 2}}
    assert growth.take({ONE: {"all": 2, "bad": 1}}) == {ONE: {"all": 0, "bad": 0}}  # no counter goes down


def test_those_that_are_gone_are_remembered_the_last_of_them() -> None:
    growth = Growth("all", 1)
    growth.take({ONE: {"all": 3}, OTHER: {"all": 5}})
    assert growth.take({}) == {}
    assert growth.take({ONE: {"all": 4}, OTHER: {"all": 6}}) == {ONE: {"all": 4}, OTHER: {"all": 1}}
