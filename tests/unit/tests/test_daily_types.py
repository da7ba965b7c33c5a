"""The daily part of all types."""

import pytest

import daily_types
from bus.types.definitions import names
from daily_types import daily_part


def test_a_part_has_each_kind_of_field(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(daily_types, "is_nightly", lambda: False)
    types = names("msg")
    part = daily_part(types)
    assert len(types) / 8 < len(part) < len(types) / 3
    assert part == daily_part(types)
    kinds = {kind for name in types for kind in daily_types._kinds(name)}
    assert kinds == {kind for name in part for kind in daily_types._kinds(name)}
    assert {"wstring", "message[<=N]", "string<=N", "float64[N]", "byte"} <= kinds


def test_at_night_all_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(daily_types, "is_nightly", lambda: True)
    assert daily_part(["a/msg/B", "a/srv/C"]) == ["a/msg/B", "a/srv/C"]
