"""bus_bridge.labels: the id of a bus, and the name of a group."""

import pytest

from bus.errors import ConfigurationError
from bus_bridge.labels import checked_group, checked_id
from rows import for_each


@for_each("text", ["robot-1", "a", "0", "R_2.x", "a" * 64])
def test_names_that_can_be(text: str) -> None:
    assert checked_id(text) == checked_group(text) == text


@for_each("text", ["", "a/b", "-a", "a b", "ä", "a" * 65, "a\n", "~", "a~b", "*"])
def test_names_that_can_not_be(text: str) -> None:
    with pytest.raises(ConfigurationError, match="the id of a bus has letters"):
        checked_id(text)
    with pytest.raises(ConfigurationError, match="the name of a group has letters"):
        checked_group(text)
