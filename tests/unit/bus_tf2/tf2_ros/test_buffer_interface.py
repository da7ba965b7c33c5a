"""Conversion of objects between registered types."""

import pytest

from bus_tf2.tf2_ros.buffer_interface import TypeException, convert


class Thing:
    def __init__(self) -> None:
        self.parts = [1, 2]


def test_an_object_of_the_type_is_copied() -> None:
    thing = Thing()
    copy = convert(thing, Thing)
    assert copy is not thing and copy.parts is not thing.parts
    assert copy.parts == [1, 2]


def test_another_type_must_be_registered() -> None:
    with pytest.raises(TypeException, match="is not loaded or supported"):
        convert(Thing(), int)
