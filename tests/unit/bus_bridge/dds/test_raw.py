"""cyclonedds' private names: with another version of cyclonedds, these tests show the changes."""

import inspect

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed: make setup installs it")

from cyclonedds import _clayer
from cyclonedds.core import Entity
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader

from bus_bridge.dds import raw


def test_the_names_are_there() -> None:
    assert callable(_clayer.ddspy_take) and callable(_clayer.ddspy_write_ts)
    assert {"_entities", "_delete", "_set_listener"} <= vars(Entity).keys()
    assert "self._ref" in inspect.getsource(Entity.__del__)


def test_they_are_used_in_the_same_way_by_the_package_itself() -> None:
    assert "ddspy_write_ts(self._ref, ser, timestamp)" in inspect.getsource(DataWriter.write)
    assert "ddspy_take(use_reader, use_mask, N)" in inspect.getsource(DataReader.take)


def test_codes_have_words() -> None:
    assert raw.describe_code(raw.TIMED_OUT) == "A timeout has occurred (timeout)"
    assert raw.describe_code(-99) == "error -99"
