"""The numbers that `bus bag play` accepts."""

from argparse import ArgumentTypeError
from collections.abc import Callable

import pytest

from bus_cli.bag.playargs import nanoseconds, not_negative, seconds


def test_seconds() -> None:
    assert [nanoseconds(seconds(text)) for text in ("0.1", "-1", "1795342862.5")] == [
        *(100_000_000, -(10**9), 1_795_342_862_500_000_000),
    ]
    assert (not_negative("0"), not_negative("2.5")) == (0.0, 2.5)


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        *((seconds, text) for text in ("", "x", "nan", "inf", "-inf", "1e10")),
        *((not_negative, text) for text in ("-0.1", "nan", "x")),
    ],
)
def test_what_is_no_such_number(parse: Callable[[str], object], text: str) -> None:
    with pytest.raises(ArgumentTypeError, match=r" is not a number of seconds"):
        parse(text)
