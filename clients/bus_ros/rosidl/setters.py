"""Constructors, getters and setters of message classes: by the native core, or compiled from source.

Owns: the values that a setter stores without its check, the defaults of fields, and both ways, which behave
the same. Must not know: the checks, the wire.
"""

from array import array
from collections.abc import Callable, Mapping
from functools import cache, partial
from operator import attrgetter
from typing import Any, Final, NamedTuple

from bus import shm
from bus.types.idl import INTEGERS, Field, Type
from bus_ros.rosidl import numbers
from bus_ros.rosidl.fields import FLOAT32_MOST

__all__ = ["Member", "add_compiled", "add_native", "bases", "member", "plain_default"]

_INT64_MOST: Final = 2**63 - 1
_SLOT: Final = "_{}"


class Usual(NamedTuple):
    """Values that a setter stores without its check: of this class, and in this range if it is a number."""

    cls: type
    least: int = 0
    most: int = 0
    largest: float | None = None


class Member(NamedTuple):
    """A field of a class that is being made."""

    name: str
    check: Callable[[Any], object] | None
    """Returns the value to store; None: all values are stored."""
    usual: Usual | None
    """None: all values are checked."""
    initial: Any
    """The value without an argument of the constructor."""
    is_made: bool
    """Whether `initial` is a function that makes the value."""

    @property
    def doc(self) -> str:
        return f"Message field '{self.name}'."


Strange = Callable[[Mapping[str, object], frozenset[str]], None]
"""Called with arguments of the constructor that are not all fields, and with the names of the fields."""


def member(field: Field, nested: type | None, check: Callable[[Any], object] | None) -> Member:
    """The member for a field; `nested` is the class of the messages in it."""
    initial, is_made = _initial(field, nested)
    return Member(field.name, check, _usual(field.type, nested), initial, is_made)


def bases() -> tuple[type, ...]:
    """The bases that classes made by `add_native` need; empty without the native core."""
    return (shm.native.MessageBase,) if shm.has_core() else ()


def add_native(cls: Any, members: list[Member], strange: Strange) -> None:
    """Add the native constructor, getters and setters to a class with a slot `_x` for each field `x`."""
    made = []
    for one in members:
        field = shm.native.MessageField(getattr(cls, _SLOT.format(one.name)), one.doc, *_limits(one))
        setattr(cls, one.name, field)
        made.append((one.name, field, one.initial, one.is_made))
    names = frozenset(one.name for one in members)
    cls.__message_fields__ = shm.native.MessageFields(names, strange, tuple(made))


def add_compiled(cls: Any, members: list[Member], strange: Strange) -> None:
    """As `add_native`, in Python."""
    names: dict[str, Any] = {"known": frozenset(one.name for one in members), "strange": strange}
    setters: list[str] = []
    given, bare = ["  if not known.issuperset(given): strange(given, known)"], []
    for index, one in enumerate(members):
        slot = _SLOT.format(one.name)
        names[f"check{index}"], names[f"initial{index}"] = one.check, one.initial
        setters.append(f"def set{index}(self, value):")
        if one.check is not None:
            setters.append(f" if {_unusual(index, one.usual, names)}: value = check{index}(value)")
        setters.append(f" self.{slot} = value")
        initial = f"initial{index}()" if one.is_made else f"initial{index}"
        given.append(f"  if {one.name!r} in given: set{index}(self, given[{one.name!r}])")
        given.append(f"  else: self.{slot} = {initial}")
        bare.append(f"  self.{slot} = {initial}")
    lines = [*setters, "def __init__(self, /, **given):", " if given:", *given]
    if bare:
        lines += [" else:", *bare]
    exec(compile("\n".join(lines), f"<class of {cls.__name__}>", "exec"), names)
    cls.__init__ = names["__init__"]
    for index, one in enumerate(members):
        get = attrgetter(_SLOT.format(one.name))
        setattr(cls, one.name, property(get, names[f"set{index}"], doc=one.doc))


def _limits(one: Member) -> tuple[Any, ...]:
    if one.usual is None:
        return (one.check,)
    cls, least, most, largest = one.usual
    bounds = (one.check, cls, least, min(most, _INT64_MOST))
    return bounds if largest is None else (*bounds, largest)


def _usual(type_: Type, nested: type | None) -> Usual | None:
    if type_.array or type_.base == "byte" or type_.string_bound is not None:
        return None
    if nested is not None:
        return Usual(nested)
    if type_.base == "float32":
        return Usual(float, largest=FLOAT32_MOST)
    if type_.base in numbers.CODES and type_.base != "float64":
        return Usual(int, *INTEGERS[type_.base])
    return Usual({"bool": bool, "float64": float}.get(type_.base, str))


def _unusual(index: int, usual: Usual | None, names: dict[str, Any]) -> str:
    """A condition for the full check of a value."""
    if usual is None:
        return "True"
    names[f"usual{index}"] = usual.cls
    other = f"value.__class__ is not usual{index}"
    if usual.cls is int:
        return f"{other} or not {usual.least} <= value <= {usual.most}"
    if usual.largest is not None:
        return f"{other} or not -{usual.largest!r} <= value <= {usual.largest!r}"
    return other


def _initial(field: Field, nested: type | None) -> tuple[Any, bool]:
    type_ = field.type
    if nested is not None:
        if type_.array == "fixed":
            return lambda: [nested() for _ in range(type_.size)], True
        return (list if type_.array else nested), True
    if not type_.array:
        return plain_default(field), False
    if type_.base in numbers.CODES:
        return _numbers(type_, field.default), True
    values = plain_default(field)
    return (values.copy if isinstance(values, list) and values else list), True


def _numbers(type_: Type, default: tuple[float, ...] | None) -> Callable[[], object]:
    code, values = numbers.CODES[type_.base], list(default or ())
    if type_.array != "fixed":
        return partial(array, code, values) if values else partial(array, code)

    @cache
    def first() -> Any:
        # Not before the first such message is made: it needs numpy.
        return numbers.fixed(code)(values or [0] * type_.size)

    return lambda: numbers.fixed(code)(first())  # a copy; one of a list takes three times as long


def plain_default(field: Field) -> object:
    """The default of a field as a plain value."""
    type_ = field.type
    if type_.array:
        if field.default is not None:
            return list(field.default)
        return [_zero(type_.base)] * (type_.size if type_.array == "fixed" else 0)
    return _zero(type_.base) if field.default is None else field.default


def _zero(base: str) -> object:
    if base == "byte":
        return b"\x00"
    if base == "bool":
        return False
    return "" if base.endswith("string") else 0.0 if base.startswith("float") else 0
