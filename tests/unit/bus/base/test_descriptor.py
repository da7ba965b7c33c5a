"""bus.base.descriptor: a descriptor is closed only once, by the first caller."""

import os
from pathlib import Path

import pytest

from bus.base.descriptor import Descriptor


def opened() -> Descriptor:
    return Descriptor(os.open("/dev/null", os.O_RDONLY | os.O_CLOEXEC))


def is_open(number: int) -> bool:
    return Path(f"/proc/self/fd/{number}").exists()


def test_closed_with_the_last_reference() -> None:
    first = second = opened()
    number = first.fileno()
    del first
    assert is_open(number)
    del second
    assert not is_open(number)


def test_closing_twice_leaves_alone_who_got_the_number_next() -> None:
    mine = opened()
    number = mine.fileno()
    mine.close()
    assert not is_open(number)
    other = opened()
    assert other.fileno() == number
    mine.close()
    assert mine.fileno() == -1
    del mine
    assert is_open(number)


def test_shows_its_number() -> None:
    assert repr(Descriptor(-1)) == "Descriptor(-1)"


def test_a_number_that_someone_else_closed_is_no_secret() -> None:
    mine = opened()
    os.close(mine.fileno())
    with pytest.raises(OSError, match="Bad file descriptor"):
        mine.close()
