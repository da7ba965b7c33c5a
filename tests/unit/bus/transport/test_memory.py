"""bus.transport.memory: buffers for data to be received."""

import pytest

from bus.transport.memory import room


@pytest.mark.parametrize("core", ["yes", "no"])
def test_a_room_has_its_size_with_and_without_the_core(core: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if core == "no":
        monkeypatch.setenv("BUS_NATIVE", "no")
    found = room(1000)
    assert type(found) is bytearray
    assert len(found) == 1000
