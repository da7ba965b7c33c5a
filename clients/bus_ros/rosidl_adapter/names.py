"""Names in definitions: their patterns, and the errors of a definition."""

import re
from typing import Final

__all__ = [
    "ACTION_FEEDBACK_MESSAGE_SUFFIX",
    "ACTION_FEEDBACK_SUFFIX",
    "ACTION_GOAL_SERVICE_SUFFIX",
    "ACTION_GOAL_SUFFIX",
    "ACTION_REQUEST_RESPONSE_SEPARATOR",
    "ACTION_RESULT_SERVICE_SUFFIX",
    "ACTION_RESULT_SUFFIX",
    "ARRAY_UPPER_BOUND_TOKEN",
    "COMMENT_DELIMITER",
    "CONSTANT_SEPARATOR",
    "PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR",
    "PRIMITIVE_TYPES",
    "SERVICE_EVENT_MESSAGE_SUFFIX",
    "SERVICE_REQUEST_MESSAGE_SUFFIX",
    "SERVICE_REQUEST_RESPONSE_SEPARATOR",
    "SERVICE_RESPONSE_MESSAGE_SUFFIX",
    "STRING_UPPER_BOUND_TOKEN",
    "VALID_CONSTANT_NAME_PATTERN",
    "VALID_FIELD_NAME_PATTERN",
    "VALID_MESSAGE_NAME_PATTERN",
    "VALID_PACKAGE_NAME_PATTERN",
    "InvalidActionSpecification",
    "InvalidFieldDefinition",
    "InvalidResourceName",
    "InvalidServiceSpecification",
    "InvalidSpecification",
    "UnknownMessageType",
    "is_valid_constant_name",
    "is_valid_field_name",
    "is_valid_message_name",
    "is_valid_package_name",
]

PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR = "/"
COMMENT_DELIMITER = "#"
CONSTANT_SEPARATOR = "="
ARRAY_UPPER_BOUND_TOKEN = STRING_UPPER_BOUND_TOKEN = "<="
SERVICE_REQUEST_RESPONSE_SEPARATOR = ACTION_REQUEST_RESPONSE_SEPARATOR = "---"
SERVICE_REQUEST_MESSAGE_SUFFIX = "_Request"
SERVICE_RESPONSE_MESSAGE_SUFFIX = "_Response"
SERVICE_EVENT_MESSAGE_SUFFIX = "_Event"
ACTION_GOAL_SUFFIX = ACTION_GOAL_SERVICE_SUFFIX = "_Goal"
ACTION_RESULT_SUFFIX = ACTION_RESULT_SERVICE_SUFFIX = "_Result"
ACTION_FEEDBACK_SUFFIX = ACTION_FEEDBACK_MESSAGE_SUFFIX = "_Feedback"

PRIMITIVE_TYPES = [
    *("bool", "byte", "char", "float32", "float64"),
    *("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
    *("string", "wstring"),
    *("duration", "time"),  # only as names: ROS 1 had them
]

VALID_PACKAGE_NAME_PATTERN = re.compile(r"^(?!.*__)(?!.*_$)[a-z][a-z0-9_]*$")
VALID_FIELD_NAME_PATTERN = VALID_PACKAGE_NAME_PATTERN
VALID_MESSAGE_NAME_PATTERN = re.compile(r"^[A-Z][A-Za-z0-9]*$")
VALID_CONSTANT_NAME_PATTERN = re.compile(r"^[A-Z]([A-Z0-9_]?[A-Z0-9]+)*$")

_SAMPLE: Final = "Sample_"
_SUFFIXES: Final = (
    SERVICE_REQUEST_MESSAGE_SUFFIX,
    SERVICE_RESPONSE_MESSAGE_SUFFIX,
    ACTION_GOAL_SERVICE_SUFFIX,
    ACTION_RESULT_SERVICE_SUFFIX,
    ACTION_FEEDBACK_MESSAGE_SUFFIX,
)


class InvalidSpecification(Exception):
    """A definition is malformed."""


class InvalidServiceSpecification(InvalidSpecification):
    """The parts of a service are not separated."""


class InvalidActionSpecification(InvalidSpecification):
    """The parts of an action are not separated."""


class InvalidResourceName(InvalidSpecification):
    """A name of a package or a message is not valid."""


class InvalidFieldDefinition(InvalidSpecification):
    """A line has a type without a name."""


class UnknownMessageType(InvalidSpecification):
    """A field has a type that is not among the known ones."""


def is_valid_package_name(name: str) -> bool:
    """Here and below, raises InvalidResourceName if `name` is no text."""
    return _matches(VALID_PACKAGE_NAME_PATTERN, name)


def is_valid_field_name(name: str) -> bool:
    return _matches(VALID_FIELD_NAME_PATTERN, name)


def is_valid_message_name(name: str) -> bool:
    """Whether it is the name of a message, or of a part of a service or an action."""
    try:
        name = name.removeprefix(_SAMPLE)
        for suffix in _SUFFIXES:
            name = name.removesuffix(suffix)
    except (AttributeError, TypeError):
        raise InvalidResourceName(name) from None
    return _matches(VALID_MESSAGE_NAME_PATTERN, name)


def is_valid_constant_name(name: str) -> bool:
    return _matches(VALID_CONSTANT_NAME_PATTERN, name)


def _matches(pattern: re.Pattern[str], name: str) -> bool:
    try:
        return pattern.fullmatch(name) is not None
    except TypeError:
        raise InvalidResourceName(name) from None
