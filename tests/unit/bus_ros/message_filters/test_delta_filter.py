"""message_filters.delta_filter: messages that pass, and values that can't be compared."""

from types import SimpleNamespace
from typing import Any

import pytest

from bus_ros.message_filters import (
    CachedComparisonHandler,
    ComparisonFilter,
    ComparisonHandler,
    DeltaFilter,
    PathDeltaFilter,
    SimpleFilter,
)


def passed(tested: Any, messages: list[Any]) -> list[Any]:
    heard: list[Any] = []
    tested.registerCallback(heard.append)
    for message in messages:
        tested.add(message)
    return heard


def point(x: float, y: float = 0.0) -> Any:
    return SimpleNamespace(at=SimpleNamespace(x=x, y=y))


def test_what_has_changed_since_the_last_that_passed() -> None:
    messages = [point(1), point(1, 5), point(1.5), point(1), point(1)]
    fitting = [messages[0], messages[2], messages[3]]
    assert passed(DeltaFilter([lambda one: one.at.x]), messages) == fitting
    assert passed(PathDeltaFilter(["at.x"]), messages) == fitting
    assert passed(PathDeltaFilter(["at.x", "at.y"]), messages) == messages[:4]
    assert passed(PathDeltaFilter([]), messages) == messages[:1]


def test_behind_another_filter() -> None:
    source = SimpleFilter()
    tested = PathDeltaFilter(["at.x"], source)
    heard: list[Any] = []
    tested.registerCallback(heard.append)
    first = point(1)
    source.signalMessage(first)
    source.signalMessage(point(1))
    assert heard == [first]
    with pytest.raises(RuntimeError, match="This instance of PathDeltaFilter already has an incoming"):
        tested.connectInput(source)


def test_what_can_not_be_compared() -> None:
    with pytest.raises(TypeError, match="Unable to compare fields of types <class 'list'>"):
        passed(DeltaFilter([lambda one: one]), [[1], [2]])
    with pytest.raises(RuntimeError, match=r"'z' of SimpleNamespace \(full path: 'at\.z'\)"):
        passed(PathDeltaFilter(["at.z"]), [point(1), point(2)])


def test_handlers_of_a_programs_own() -> None:
    class Rising(CachedComparisonHandler):
        _field_getters = (lambda one: one,)

        def do_fields_fit(self, field_a: Any, field_b: Any) -> bool:
            return bool(field_b > field_a)

    class Even(ComparisonHandler):
        def message_fits(self, message: Any) -> bool:
            return bool(message % 2 == 0)

    class Unfinished(CachedComparisonHandler):
        _field_getters = (lambda one: one,)

    assert passed(ComparisonFilter(Rising()), [3, 1, 4, 1, 5]) == [3, 4, 5]
    assert passed(ComparisonFilter(Even()), [3, 4, 6, 7]) == [4, 6]
    with pytest.raises(NotImplementedError, match="not implemented for class: Unfinished"):
        passed(ComparisonFilter(Unfinished()), [1, 2])
