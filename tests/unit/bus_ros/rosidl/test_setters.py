"""Constructors, getters and setters of message classes: the native ones and the compiled ones do the same."""

import gc
import math
import sys
from collections.abc import Mapping
from typing import Any, NoReturn
from weakref import ref

import pytest

from bus import shm
from bus.types.idl import Field, Type
from bus_ros.rosidl import setters
from bus_ros.rosidl.fields import FLOAT32_MOST, checker
from rows import for_each

needs_core = pytest.mark.skipif(not shm.has_core(), reason="the native core is not built")


class Strange(Exception):
    pass


def strange(given: Mapping[str, object], known: frozenset[str]) -> None:
    if not known.issuperset(given.keys() - {"allowed"}):
        raise Strange(sorted(given), sorted(known))


def made(way: str, *members: setters.Member) -> Any:
    """A class with these members."""
    bases = (shm.native.MessageBase,) if way == "native" else ()
    cls = type("Made", bases, {"__slots__": [f"_{one.name}" for one in members]})
    (setters.add_native if way == "native" else setters.add_compiled)(cls, list(members), strange)
    return cls


def of_type(base: str, *, checks: list[object], array: str = "", default: Any = None) -> setters.Member:
    """A member x of that type, whose check notes each value in `checks`."""
    field = Field(name="x", type=Type(base, None, array), default=default)
    check = checker(field, None, is_strict=False)

    def noting(value: object) -> object:
        checks.append(value)
        return check(value)

    return setters.member(field, None, noting)


@pytest.fixture(params=[pytest.param("native", marks=needs_core), "compiled"])
def way(request: pytest.FixtureRequest) -> str:
    return str(request.param)


AT_ONCE: dict[str, list[object]] = {
    "string": ["", "text"],
    "bool": [True, False],
    "float64": [0.5, math.inf, -math.inf],
    "float32": [0.5, FLOAT32_MOST, -FLOAT32_MOST],
    "int8": [-128, 127, 0],
    "uint8": [0, 255],
    "int64": [-(2**63), 2**63 - 1],
    "uint64": [0, 2**63 - 1],
}
"""Values that are stored without the check."""

WRONG: dict[str, list[object]] = {
    "string": [b"text", None, 1],
    "bool": [1, None],
    "float64": [1, "1"],
    "float32": [1, FLOAT32_MOST * 2],
    "int8": [-129, 128, 1.0, 2**70],
    "uint8": [-1, 256],
    "int64": [2**63, -(2**63) - 1],
    "uint64": [-1, 2**64],
}


@for_each("base", AT_ONCE)
def test_usual_values_are_stored_at_once(base: str, way: str) -> None:
    checks: list[object] = []
    message = made(way, of_type(base, checks=checks))()
    for value in AT_ONCE[base]:
        message.x = value
        assert message.x is value is message._x
    assert checks == []


@for_each("base", WRONG)
def test_other_values_are_checked(base: str, way: str) -> None:
    checks: list[object] = []
    cls = made(way, of_type(base, checks=checks))
    message = cls()
    before = message.x
    for value in WRONG[base]:
        with pytest.raises(AssertionError, match="The 'x' field must be"):
            message.x = value
        with pytest.raises(AssertionError, match="The 'x' field must be"):
            cls(x=value)
    assert message.x is before
    assert len(checks) == 2 * len(WRONG[base])


def test_a_check_converts(way: str) -> None:
    class Text(str):
        pass

    checks: list[object] = []
    message = made(way, of_type("float64", checks=checks, array="unbounded", default=(1.0,)))()
    message.x = [2, 3]
    assert list(message.x) == [2.0, 3.0]
    message = made(way, of_type("uint64", checks=checks))()
    message.x = 2**64 - 1
    assert message.x == 2**64 - 1
    message.x = True
    assert message.x == 1 and type(message.x) is int
    message = made(way, of_type("string", checks=checks))(x=Text("a"))
    assert message.x == "a"
    message = made(way, of_type("float32", checks=checks))()
    for value in (math.nan, math.inf):
        message.x = value
        assert message.x is value


def test_without_a_check_all_is_stored(way: str) -> None:
    message = made(way, setters.Member("x", None, None, "", False))()
    message.x = here = object()
    assert message.x is here


def test_the_constructor(way: str) -> None:
    def fail() -> NoReturn:
        raise OverflowError

    number = setters.Member("number", None, None, 7, False)
    several = setters.Member("several", None, None, list, True)
    cls = made(way, number, several)
    first, second = cls(), cls(number=8, allowed=1)
    assert (first.number, first.several, second.number, second.several) == (7, [], 8, [])
    assert first.several is not second.several
    first.__init__(number=9)
    assert first.number == 9
    with pytest.raises(Strange, match="'numer'"):
        cls(number=1, numer=2)
    with pytest.raises(TypeError, match="takes 1 positional argument but 2 were given"):
        cls(1)
    with pytest.raises(OverflowError):
        made(way, setters.Member("x", None, None, fail, True))()
    assert made(way)() is not None


def test_classes_of_programs(way: str) -> None:
    class Own(made(way, setters.Member("x", None, None, 7, False))):  # type: ignore[misc]
        def __init__(self, more: int) -> None:
            super().__init__(x=more + 1)
            self.more = more

    message = Own(1)
    assert (message.x, message.more) == (2, 1)
    message.x = 3
    assert message.x == message._x == 3


def test_descriptors(way: str) -> None:
    cls = made(way, setters.Member("x", None, None, 7, False))
    assert cls.x.__doc__ == "Message field 'x'."
    message = cls()
    with pytest.raises(AttributeError):
        del message.x
    del message._x
    with pytest.raises(AttributeError):
        _ = message.x
    with pytest.raises((AttributeError, TypeError)):
        cls.x.__set__(object(), 1)


def test_a_class_and_its_messages_are_freed(way: str) -> None:
    value = object()
    counted = sys.getrefcount(value)
    cls = made(way, setters.Member("x", None, setters.Usual(str), value, False))
    message = cls()
    message.x = message.x
    gone = ref(cls)
    del message, cls
    gc.collect()
    assert gone() is None
    assert sys.getrefcount(value) == counted


@needs_core
def test_wrong_use_of_the_native_classes() -> None:
    cls: Any = made("native", setters.Member("x", None, None, 7, False))
    for arguments in ((1, "doc"), (cls._x, "doc", None, 5), (cls._x,)):
        with pytest.raises(TypeError):
            shm.native.MessageField(*arguments)
    some: Any
    for some in ((1,), (("x", 1, 2, True),), (("x",),), [1]):
        with pytest.raises(TypeError):
            shm.native.MessageFields(frozenset(), strange, some)
    cls.__message_fields__ = 5
    with pytest.raises(TypeError, match="__message_fields__ must be a MessageFields"):
        cls()
    del cls.__message_fields__
    with pytest.raises(AttributeError, match="__message_fields__"):
        cls()
    with pytest.raises(AttributeError):
        shm.native.MessageBase()
