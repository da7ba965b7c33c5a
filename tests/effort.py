"""The part of random examples that a test tries: a sixth in `make test`, all in `make nightly`."""

import hypothesis

DAILY, NIGHTLY = 16, 100
"""Percentages, and hypothesis's numbers of examples for tests without their own."""


def examples(number: int) -> int:
    """The part of `number`, at least one. Call it only once the tests are collected."""
    return -(-number * _percent() // NIGHTLY)


def is_nightly() -> bool:
    """Whether these are the tests of `make nightly`. Call it when `examples` may be called."""
    return _percent() == NIGHTLY


def _percent() -> int:
    profile = hypothesis.settings.default
    assert profile is not None
    return profile.max_examples
