"""tests/mutants/mutants.toml matches the tree."""

from mutants.__main__ import mistakes, read


def test_what_is_broken_is_there_once_and_so_are_the_tests_that_must_fail() -> None:
    mutants = read()
    assert [mistake for one in mutants for mistake in mistakes(one)] == []
    assert [one.breaks for one in mutants if not one.tests] == []
