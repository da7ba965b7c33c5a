"""Parses interface definitions: the text of a .msg, .srv or .action file becomes values.

Owns: the grammar, as in rosidl, and the texts of its errors. Must not know: the places of files, whether a
type in a definition exists, Python classes.

    # a comment                           a field is a type and a name, and may have a default
    int32 LIMIT=10                        a constant has an upper-case name and a value
    string<=10 label "none"               a text of at most 10 characters
    float64[] xs [1.0, 2]                 `T[]` any number of values, `T[<=3]` at most 3, `T[3]` exactly 3
    geometry_msgs/Point32[] corners       or `geometry_msgs/msg/Point32`, or `Corner` of the same package
    Header header                         std_msgs/msg/Header, unless the package has a Header of its own

A line `---` separates the request of a service from its response, and an action's three messages.
"""

import re
from typing import Any, Final, NamedTuple

from bus.errors import ConfigurationError

__all__ = [
    "CARRIERS",
    "INTEGERS",
    "PARTS",
    "PRIMITIVES",
    "Action",
    "Constant",
    "Field",
    "Message",
    "Service",
    "Type",
    "carriers",
    "code_of",
    "event_of",
    "parse_action",
    "parse_message",
    "parse_part",
    "parse_service",
]

INTEGERS: Final = {
    "byte": (0, 2**8 - 1),
    "char": (0, 2**8 - 1),
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
"""The lowest and the highest value of each integer type."""

PRIMITIVES: Final = frozenset((*INTEGERS, "bool", "float32", "float64", "string", "wstring"))

PARTS: Final = {"srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
"""Suffixes of the messages of a service or an action: `SetBool` has `SetBool_Request`."""

CARRIERS: Final = {
    "SendGoal_Request": (("goal_id", "unique_identifier_msgs/msg/UUID"), ("goal", "Goal")),
    "SendGoal_Response": (("accepted", "bool"), ("stamp", "builtin_interfaces/msg/Time")),
    "GetResult_Request": (("goal_id", "unique_identifier_msgs/msg/UUID"),),
    "GetResult_Response": (("status", "int8"), ("result", "Result")),
    "FeedbackMessage": (("goal_id", "unique_identifier_msgs/msg/UUID"), ("feedback", "Feedback")),
}
"""The messages that ROS 2 adds to each action, with their fields. They carry the action's parts."""

_EVENT: Final = ("info", "request", "response")

_HEADER: Final = "Header"
_SHORT_NAMES: Final = {
    _HEADER: _HEADER,  # the package decides: see `_parse_parts`
    "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
}
_LOWER: Final = re.compile(r"[a-z](_?[a-z0-9])*")
_UPPER: Final = re.compile(r"[A-Z](_?[A-Z0-9])*")
_CAMEL: Final = re.compile(r"[A-Z][A-Za-z0-9]*")
_PART: Final = re.compile(r"[A-Z][A-Za-z0-9]*_[A-Z][A-Za-z0-9_]*")
_TYPE: Final = re.compile(r"([A-Za-z][\w/]*)(?:<=(\d+))?(?:\[(<=)?(\d*)\])?", re.ASCII)
_QUOTED: Final = r'"(?:\\.|[^"\\])*"|' + r"'(?:\\.|[^'\\])*'"
_CODE: Final = re.compile(rf"(?:(?<=[\s=,\[])(?:{_QUOTED})|[^#])*")
"""A line up to its comment. A `#` inside a quoted text begins no comment."""
_ELEMENT: Final = re.compile(rf"\s*+({_QUOTED}|[^,\"'\[\]]++)\s*+(?:,|$)")
"""An element, perhaps with blanks behind it. The parts share no blanks: a hostile text would take hours."""
_MAX_SIZE: Final = 2**31 - 1
_MAX_DIGITS: Final = 10


class Type(NamedTuple):
    """The type of a field: `string<=10[3]` is `Type("string", 10, "fixed", 3)`."""

    base: str
    """A primitive (one of PRIMITIVES), or the full name of a message: `std_msgs/msg/Header`."""
    string_bound: int | None = None
    array: str = ""
    """Empty, `fixed`, `bounded` or `unbounded`."""
    size: int = 0
    """Number of elements: exactly (`fixed`) or at most (`bounded`)."""


class Field(NamedTuple):
    """One field of a message.

    The default is None if the definition has none, else a Python value: a `byte` is `bytes` of length 1, an
    array a tuple.
    """

    name: str
    type: Type
    default: Any = None
    line: int = 0
    """The line in its file."""


class Constant(NamedTuple):
    """A constant of a message; its value has the form of a default."""

    name: str
    type: Type
    value: Any


class Message(NamedTuple):
    """A message, `std_msgs/msg/String`, or a part of a service or action, `std_srvs/srv/SetBool_Request`."""

    name: str
    fields: tuple[Field, ...] = ()
    constants: tuple[Constant, ...] = ()


class Service(NamedTuple):
    """A service, for example `std_srvs/srv/SetBool`."""

    name: str
    request: Message
    response: Message


class Action(NamedTuple):
    """An action, for example `example_interfaces/action/Fibonacci`."""

    name: str
    goal: Message
    result: Message
    feedback: Message


def parse_message(text: str, name: str, *, has_header: bool = False) -> Message:
    """Parse the text of a .msg file; `name` is like `std_msgs/msg/String`.

    `has_header`: the package has a message Header, which `Header` without a package means then. Else it is
    std_msgs/msg/Header, as in ROS 1. Raises ConfigurationError with the line and its fault.
    """
    return _parse(text, name, "msg", ("",), has_header)[0]


def parse_service(text: str, name: str, *, has_header: bool = False) -> Service:
    """Parse the text of a .srv file; arguments and errors are like those of `parse_message`."""
    request, response = _parse(text, name, "srv", PARTS["srv"], has_header)
    return Service(name, request, response)


def parse_action(text: str, name: str, *, has_header: bool = False) -> Action:
    """Parse the text of an .action file; arguments and errors are like those of `parse_message`."""
    goal, result, feedback = _parse(text, name, "action", PARTS["action"], has_header)
    return Action(name, goal, result, feedback)


def event_of(service: Service) -> Message:
    """The message that reports a request or an answer, if introspection is on."""
    parts = (
        (field, Type(f"{service.name}_{field.capitalize()}", None, "bounded", 1)) for field in _EVENT[1:]
    )
    info = Field(_EVENT[0], Type("service_msgs/msg/ServiceEventInfo"))
    return Message(f"{service.name}_Event", (info, *(Field(field, type_) for field, type_ in parts)))


def carriers(action: Action) -> dict[str, Message]:
    """The messages that carry the parts of `action`, by their names in CARRIERS."""
    return {
        name: Message(
            f"{action.name}_{name}",
            tuple(
                Field(field, Type(f"{action.name}_{base}" if base in PARTS["action"] else base))
                for field, base in fields
            ),
        )
        for name, fields in CARRIERS.items()
    }


def parse_part(text: str, name: str, *, has_header: bool = False) -> Message:
    """Parse one type of a text with a type and all types that it needs, as in bag files.

    It may be a part of a service or an action, `std_srvs/srv/SetBool_Event`, and so may the types of its
    fields. Arguments and errors are like those of `parse_message`.
    """
    return _parse_parts(text, name, name.split("/")[1], ("",), has_header)[0]


class _Wrong(Exception):
    """The fault of a line."""


def _parse(text: str, name: str, kind: str, parts: tuple[str, ...], has_header: bool) -> list[Message]:
    _check_name(name, kind)
    return _parse_parts(text, name, kind, parts, has_header)


def _parse_parts(text: str, name: str, kind: str, parts: tuple[str, ...], has_header: bool) -> list[Message]:
    package = name.partition("/")[0]
    header = f"{package if has_header else 'std_msgs'}/msg/{_HEADER}"
    messages = [Message(f"{name}_{part}" if part else name) for part in parts]
    fields: list[list[Field]] = [[] for _ in parts]
    constants: list[list[Constant]] = [[] for _ in parts]
    names: list[set[str]] = [set() for _ in parts]
    at = number = 0
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text.removeprefix("\ufeff")), 1):
        code = code_of(line)
        try:
            if code == "---":
                at += 1
                if at == len(parts):
                    raise _Wrong(f"one '---' too many: {_article(kind)} has {_count(len(parts) - 1)}")
            elif code:
                entry = _entry(code, package, number)
                if entry.name in names[at]:
                    raise _Wrong(f"there are two of the name '{entry.name}'")
                names[at].add(entry.name)
                if isinstance(entry, Field):
                    if entry.type.base == _HEADER:
                        entry = entry._replace(type=entry.type._replace(base=header))
                    fields[at].append(entry)
                else:
                    constants[at].append(entry)
        except _Wrong as error:
            raise ConfigurationError(f"{name}.{kind}:{number}: {error}") from None
    if at < len(parts) - 1:
        raise ConfigurationError(
            f"{name}.{kind}:{number}: the definition ends too early: "
            f"{_article(kind)} has {_count(len(parts) - 1)}, here: {at}"
        )
    return [
        message._replace(fields=tuple(fields[i]), constants=tuple(constants[i]))
        for i, message in enumerate(messages)
    ]


def _check_name(name: str, kind: str) -> None:
    package, _, rest = name.partition(f"/{kind}/")
    if not _LOWER.fullmatch(package):
        raise ConfigurationError(
            f"'{name}': a package has lower-case letters, digits and single underscores: my_package"
        )
    if not _CAMEL.fullmatch(rest):
        raise ConfigurationError(f"'{name}': the name of a definition begins with a capital: MyMessage")


def _article(kind: str) -> str:
    return {"msg": "a message", "srv": "a service", "action": "an action"}[kind]


def _count(separators: int) -> str:
    return f"{separators or 'no'} line{'s' * (separators != 1)} '---'"


def code_of(line: str) -> str:
    """A line without its comment."""
    found = _CODE.match(line)
    return found[0].strip() if found else ""


def _entry(code: str, package: str, line: int) -> Field | Constant:
    type_text, *others = code.split(None, 1)
    type_ = _type(type_text, package)
    found = re.match(r"([^\s=]+)\s*(=?)\s*(.*)", others[0], re.DOTALL) if others else None
    if found is None:
        raise _Wrong(f"'{type_text}' has no name after it")
    name, is_constant, value = found.groups()
    if is_constant:
        if type_.array or type_.base not in PRIMITIVES:
            raise _Wrong(f"a constant has one value of a primitive type, not '{type_text}'")
        if not _UPPER.fullmatch(name):
            raise _Wrong(f"'{name}' is no name of a constant: they have capitals, digits and _")
        if not value:
            raise _Wrong(f"constant '{name}' has no value")
        return Constant(name, type_, _single(type_, value))
    if not _LOWER.fullmatch(name):
        hint = f"; a constant has a value: {name}=1" if _UPPER.fullmatch(name) and not value else ""
        raise _Wrong(
            f"'{name}' is no name of a field: "
            f"they have lower-case letters, digits and single underscores between them{hint}"
        )
    return Field(name, type_, _default(type_, value) if value else None, line)


def _type(text: str, package: str) -> Type:
    found = _TYPE.fullmatch(text)
    if found is None:
        raise _Wrong(f"'{text}' is no type")
    base, bound, at_most, size = found.groups()
    base = _base(base, package)
    if bound is not None and base not in ("string", "wstring"):
        raise _Wrong(f"'{text}': only a string has a limit of its own; an array has it in brackets: [<=3]")
    limit = _size(bound, text) if bound is not None else None
    if size is None:
        return Type(base, limit)
    if size == "":
        if at_most:
            raise _Wrong(f"'{text}' has no number after <=")
        return Type(base, limit, "unbounded")
    return Type(base, limit, "bounded" if at_most else "fixed", _size(size, text))


def _size(digits: str, text: str) -> int:
    if len(digits) > _MAX_DIGITS or not 1 <= int(digits) <= _MAX_SIZE:
        raise _Wrong(f"'{text}': a size is from 1 to {_MAX_SIZE}")
    return int(digits)


def _base(text: str, package: str) -> str:
    if text in PRIMITIVES:
        return text
    if text in _SHORT_NAMES:
        return _SHORT_NAMES[text]
    parts = text.split("/")
    if len(parts) == 1:
        parts.insert(0, package)
    if len(parts) == 3 and parts[1] == "msg":
        del parts[1]
    if len(parts) == 3 and parts[1] in PARTS and _LOWER.fullmatch(parts[0]) and _PART.fullmatch(parts[2]):
        return text
    if len(parts) == 2 and _LOWER.fullmatch(parts[0]) and _CAMEL.fullmatch(parts[1]):
        return f"{parts[0]}/msg/{parts[1]}"
    raise _Wrong(f"'{text}' is not a known type{_meant(text)}")


def _meant(text: str) -> str:
    from bus.base.suggest import did_you_mean

    return did_you_mean(text, PRIMITIVES) or did_you_mean(text.lower(), PRIMITIVES)


def _default(type_: Type, text: str) -> Any:
    if type_.base not in PRIMITIVES:
        raise _Wrong(f"a field of type '{type_.base}' can't have a default ({text})")
    if not type_.array:
        return _single(type_, text)
    if not (text.startswith("[") and text.endswith("]")) or len(text) < 2:
        raise _Wrong(f"the default of an array is in brackets, like [1, 2]; it is {text}")
    values = tuple(_single(type_, element) for element in _elements(text[1:-1], text))
    if type_.array == "fixed" and len(values) != type_.size:
        raise _Wrong(f"the array has {type_.size} values, its default {len(values)}")
    if type_.array == "bounded" and len(values) > type_.size:
        raise _Wrong(f"the array has at most {type_.size} values, its default {len(values)}")
    return values


def _elements(inner: str, text: str) -> list[str]:
    elements: list[str] = []
    at = 0 if inner.strip() else len(inner)
    while at < len(inner):
        found = _ELEMENT.match(inner, at)
        if found is None:
            raise _Wrong(f"{text} is no list of values")
        elements.append(found[1].rstrip())
        at = found.end()
    return elements


def _integer(text: str) -> int:
    """As in rosidl: decimal, also with leading zeros; else with a prefix, as 0x1f."""
    try:
        return int(text)
    except ValueError:
        return int(text, 0)


def _single(type_: Type, text: str) -> Any:
    base = type_.base
    if base in ("string", "wstring"):
        return _string(type_, text)
    try:
        if base == "bool":
            return {"true": True, "1": True, "false": False, "0": False}[text.lower()]
        if base in ("float32", "float64"):
            return float(text)
        value = _integer(text)
    except (KeyError, ValueError):
        raise _Wrong(f"{text:.80} is no value of type {base}") from None
    least, most = INTEGERS[base]
    if not least <= value <= most:
        raise _Wrong(f"{text:.80} is no value of type {base}: from {least} to {most}")
    return bytes((value,)) if base == "byte" else value


def _string(type_: Type, text: str) -> str:
    if text[0] in "\"'":
        if not re.fullmatch(_QUOTED, text):
            raise _Wrong(f"{text:.80} is no quoted text: the other quote must be its end")
        text = text[1:-1].replace(f"\\{text[0]}", text[0])
    if type_.string_bound is not None and len(text) > type_.string_bound:
        raise _Wrong(f"'{text:.80}' is longer than {type_.string_bound}")
    return text
