"""How much of a random thing a test tries: a third in `make test`, all of it in `make nightly`."""

import hypothesis

DAILY, NIGHTLY = 33, 100
"""Percent, and hypothesis's number of examples where a test names none."""


def examples(number: int) -> int:
    """So many of `number`, at least one. To be asked once the tests are collected, or later."""
    return -(-number * _percent() // NIGHTLY)


def is_nightly() -> bool:
    """Whether these are the tests of `make nightly`. To be asked as `examples` is."""
    return _percent() == NIGHTLY


def _percent() -> int:
    profile = hypothesis.settings.default
    assert profile is not None
    return profile.max_examples
