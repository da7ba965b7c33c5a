"""Names of nodes, namespaces and topics: their rules, and the expansion of a topic's name to its full name.

Owns the rules and texts of rcl/validate_topic_name.c, rcl/expand_topic_name.c and rmw/validate_*.c. Must not
know about remapping (`bus.process.ros_args`) or the graph.

A validator returns nothing and raises ConfigurationError. The error has the index of the first wrong
character and the text that rclpy would print, with a caret under that character.
"""

import re
from collections.abc import Callable

from bus.errors import ConfigurationError

__all__ = [
    "MAX_NAMESPACE_LENGTH",
    "MAX_NODE_NAME_LENGTH",
    "MAX_TOPIC_NAME_LENGTH",
    "absolute_namespace",
    "expand_topic_name",
    "is_hidden_node",
    "is_hidden_topic",
    "join_node_name",
    "logger_name",
    "reply_topic",
    "request_topic",
    "service_of_topic",
    "split_node_name",
    "topic_in_node",
    "validate_full_topic_name",
    "validate_namespace",
    "validate_node_name",
    "validate_topic_name",
]

MAX_NODE_NAME_LENGTH = 255
MAX_TOPIC_NAME_LENGTH = 247
"""DDS allows 255; ROS 2 needs 8 of them for its prefixes and suffixes."""
MAX_NAMESPACE_LENGTH = 245
"""This leaves room for a slash and a node or topic with one letter."""

# Compiled only for wrong names and substitutions: other names need no pattern.
_NOT_WORD = r"[^A-Za-z0-9_]"
_NOT_WORD_OR_SLASH = r"[^A-Za-z0-9_/]"
_BAD_TOKEN_START = r"/[/0-9]"
_NUMBER_AFTER_SLASH = r"/[0-9]"
_SUBSTITUTION = r"\{([^{}]*)\}"
_SHOWN_LENGTH = 256
_DIGITS = frozenset("0123456789")

_REQUEST = "/_request"
_REPLY = "/_reply"

_ENDS_WITH_SLASH = "must not end with a '/'"
_UNMATCHED_BRACE = "topic name must not have unmatched (unbalanced) curly braces '{}'"

# A fault: the broken rule in ROS's words, and the index of the first character that breaks it.
_Fault = tuple[str, int]


def validate_node_name(name: str) -> None:
    """Check a node's base name: `[A-Za-z_][A-Za-z0-9_]*`, without namespace."""
    _check("node name", name, _node_name_fault)


def validate_namespace(namespace: str) -> None:
    """Check a namespace: "/", or tokens that each follow a slash."""
    _check("namespace", namespace, _namespace_fault)


def validate_topic_name(name: str) -> None:
    """Check a typed topic: relative or absolute, with `~` and `{substitutions}`."""
    _check("topic name", name, _typed_topic_fault)


def validate_full_topic_name(name: str) -> None:
    """Check a topic of the graph: absolute, without anything to expand."""
    _check("topic name", name, _full_topic_fault)


def expand_topic_name(name: str, node: str, namespace: str) -> str:
    """The full name of a topic typed in `node`, whose namespace is `namespace`.

    First a leading `~` becomes the node's full name, then `{node}`, `{ns}` and `{namespace}` are replaced. A
    name that is still relative gets the namespace in front. Absolute names without substitutions stay as they
    are.

    Raises ConfigurationError if one of the three names, or the result, breaks its rules.
    """
    validate_topic_name(name)
    validate_node_name(node)
    validate_namespace(namespace)
    return topic_in_node(name, node, namespace)


def topic_in_node(name: str, node: str, namespace: str) -> str:
    """As `expand_topic_name`, for a node with names that were checked at its creation."""
    if isinstance(name, str) and _are_words(name.removeprefix("/").split("/")):  # no substitution
        full = name if name[0] == "/" else join_node_name(namespace, name)
        if len(full) <= MAX_TOPIC_NAME_LENGTH:
            return full
    validate_topic_name(name)
    known = {"node": node, "ns": namespace, "namespace": namespace}
    full = join_node_name(namespace, node) + name[1:] if name[0] == "~" else name
    if "{" in name:
        for found in re.finditer(_SUBSTITUTION, name):
            if found[1] not in known:
                raise _invalid("topic name", name, (f"unknown substitution: {found[0]}", found.start()))
        full = re.sub(_SUBSTITUTION, lambda found: known[found[1]], full)
    if full[0] != "/":
        full = join_node_name(namespace, full)
    fault = _full_topic_fault(full)
    if fault is not None:
        raise _invalid("topic name", full, fault, typed=name)
    return full


def absolute_namespace(namespace: str) -> str:
    """The namespace with the leading slash that users may leave out; "" is the root (rcl/node.c)."""
    full = namespace if namespace.startswith("/") else "/" + namespace
    validate_namespace(full)
    return full


def join_node_name(namespace: str, name: str) -> str:
    """`/ns` and `node` make `/ns/node`; `/` and `node` make `/node`."""
    return f"/{name}" if namespace == "/" else f"{namespace}/{name}"


def split_node_name(full_name: str) -> tuple[str, str]:
    """Namespace and base name of a node's full name; the leading slash may be missing."""
    namespace, _, name = full_name.rpartition("/")
    return absolute_namespace(namespace), name


def logger_name(namespace: str, name: str) -> str:
    """The name of a node's logger: the full name with dots for slashes (rcl/logging_rosout.c)."""
    return join_node_name(namespace, name)[1:].replace("/", ".")


def is_hidden_topic(name: str) -> bool:
    """Whether a token begins with `_`: tools leave such topics out of their lists."""
    return any(token.startswith("_") for token in name.split("/"))


def request_topic(service: str) -> str:
    """The hidden topic of a service's requests."""
    return service + _REQUEST


def reply_topic(service: str) -> str:
    """The hidden topic of a service's answers."""
    return service + _REPLY


def service_of_topic(topic: str) -> str | None:
    """The service of a topic for requests or replies; None for any other topic."""
    for end in (_REQUEST, _REPLY):
        if topic.endswith(end) and len(topic) > len(end):
            return topic.removesuffix(end)
    return None


def is_hidden_node(name: str) -> bool:
    """Whether a node's base name begins with `_`, as in nodes of tools; `name` is a base name or a full
    name."""
    return name.rpartition("/")[2].startswith("_")


def _node_name_fault(name: str) -> _Fault | None:
    if len(name) > MAX_NODE_NAME_LENGTH:
        return f"node name length should not exceed '{MAX_NODE_NAME_LENGTH}'", MAX_NODE_NAME_LENGTH - 1
    if _is_word(name):
        return None
    if not name:
        return "node name must not be empty", 0
    if bad := re.search(_NOT_WORD, name):
        return "node name must not contain characters other than alphanumerics or '_'", bad.start()
    return "node name must not start with a number", 0


def _namespace_fault(namespace: str) -> _Fault | None:
    if namespace == "/":
        return None
    if len(namespace) > MAX_NAMESPACE_LENGTH:
        return f"namespace should not exceed '{MAX_NAMESPACE_LENGTH}'", MAX_NAMESPACE_LENGTH - 1
    fault = _absolute_name_fault(namespace)
    if fault is None:
        return None
    rule, index = fault
    exception = ", unless only a '/'" if rule == _ENDS_WITH_SLASH else ""
    return f"namespace {rule}{exception}", index


def _full_topic_fault(name: str) -> _Fault | None:
    if len(name) > MAX_TOPIC_NAME_LENGTH:
        return f"topic length should not exceed '{MAX_TOPIC_NAME_LENGTH}'", MAX_TOPIC_NAME_LENGTH - 1
    fault = _absolute_name_fault(name)
    return None if fault is None else (f"topic name {fault[0]}", fault[1])


def _absolute_name_fault(name: str) -> _Fault | None:
    """The fault by the common rules of topics and namespaces, without the noun in front."""
    if name.startswith("/") and _are_words(name[1:].split("/")):
        return None
    if not name:
        return "must not be empty", 0
    if name[0] != "/":
        return "must be absolute, it must lead with a '/'", 0
    if name[-1] == "/":
        return _ENDS_WITH_SLASH, len(name) - 1
    if bad := re.search(_NOT_WORD_OR_SLASH, name):
        return "must not contain characters other than alphanumerics, '_', or '/'", bad.start()
    bad = re.search(_BAD_TOKEN_START, name)
    assert bad is not None, name
    if bad[0] == "//":
        return "must not contain repeated '/'", bad.start() + 1
    return "must not have a token that starts with a number", bad.start() + 1


def _is_word(text: str) -> bool:
    """Whether a text matches `[A-Za-z_][A-Za-z0-9_]*`."""
    return text.isascii() and text.isidentifier()


def _are_words(texts: list[str]) -> bool:
    return all(map(str.isascii, texts)) and all(map(str.isidentifier, texts))


def _typed_topic_fault(name: str) -> _Fault | None:
    if _are_words(name.removeprefix("/").split("/")):
        return None
    if not name:
        return "topic name must not be empty string", 0
    if name[0] in _DIGITS:
        return "topic name token must not start with a number", 0
    if name[-1] == "/":
        return "topic name must not end with a forward slash", len(name) - 1
    if fault := _character_fault(name):
        return fault
    # rcl accepts a two-letter name such as `~a` by accident, against its rule.
    if name[0] == "~" and len(name) > 1 and name[1] != "/":
        return "topic name must not have a tilde '~' that is not followed by a forward slash '/'", 1
    bad = re.search(_NUMBER_AFTER_SLASH, name)
    return None if bad is None else ("topic name token must not start with a number", bad.start() + 1)


def _character_fault(name: str) -> _Fault | None:
    opened: int | None = None
    for found in re.finditer(r"[^A-Za-z0-9_]|(?<=\{)[0-9]", name):
        character, index = found[0], found.start()
        if character in _DIGITS:
            return "substitution name must not start with a number", index
        if character == "~":
            if index > 0:
                return "topic name must not have tilde '~' unless it is the first character", index
        elif character == "}":
            if opened is None:
                return _UNMATCHED_BRACE, index
            opened = None
        elif opened is not None:
            return "substitution name must not contain characters other than alphanumerics or '_'", index
        elif character == "{":
            opened = index
        elif character != "/":
            return (
                "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'",
                index,
            )
    return None if opened is None else (_UNMATCHED_BRACE, opened)


def _check(what: str, value: object, find_fault: Callable[[str], _Fault | None]) -> None:
    if not isinstance(value, str):
        given = (
            f"the class {value.__qualname__}"
            if isinstance(value, type)
            else f"{type(value).__name__} {value!r}"
        )
        raise ConfigurationError(f"{what} must be a string, not {given}")
    if (fault := find_fault(value)) is not None:
        raise _invalid(what, value, fault)


def _invalid(what: str, name: str, fault: _Fault, *, typed: str | None = None) -> ConfigurationError:
    rule, index = fault
    # Names come from the wire, too: show enough for the caret, not a megabyte.
    length = max(index + 1, _SHOWN_LENGTH)
    # With one column for each character, the caret is at the right place.
    shown = "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in name[:length]
    )
    cut = "..." if len(name) > length else ""
    origin = f" (expanded from '{typed}')" if typed not in (None, name) else ""
    return ConfigurationError(
        f"Invalid {what}: {rule}:\n  '{shown}{cut}'{origin}\n   {' ' * index}^", index=index
    )
