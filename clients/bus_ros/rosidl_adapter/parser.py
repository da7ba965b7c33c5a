"""`rosidl_adapter.parser`: the text of a definition as values, with its comments.

Other parts of the package have the classes; programs find them all here.
"""

import sys
from pathlib import Path

from bus_ros.rosidl_adapter.comments import (
    extract_file_level_comments,
    process_comments,
)
from bus_ros.rosidl_adapter.names import (
    ACTION_FEEDBACK_MESSAGE_SUFFIX,
    ACTION_FEEDBACK_SUFFIX,
    ACTION_GOAL_SERVICE_SUFFIX,
    ACTION_GOAL_SUFFIX,
    ACTION_REQUEST_RESPONSE_SEPARATOR,
    ACTION_RESULT_SERVICE_SUFFIX,
    ACTION_RESULT_SUFFIX,
    ARRAY_UPPER_BOUND_TOKEN,
    COMMENT_DELIMITER,
    CONSTANT_SEPARATOR,
    PACKAGE_NAME_MESSAGE_TYPE_SEPARATOR,
    PRIMITIVE_TYPES,
    SERVICE_EVENT_MESSAGE_SUFFIX,
    SERVICE_REQUEST_MESSAGE_SUFFIX,
    SERVICE_REQUEST_RESPONSE_SEPARATOR,
    SERVICE_RESPONSE_MESSAGE_SUFFIX,
    STRING_UPPER_BOUND_TOKEN,
    VALID_CONSTANT_NAME_PATTERN,
    VALID_FIELD_NAME_PATTERN,
    VALID_MESSAGE_NAME_PATTERN,
    VALID_PACKAGE_NAME_PATTERN,
    InvalidActionSpecification,
    InvalidFieldDefinition,
    InvalidResourceName,
    InvalidServiceSpecification,
    InvalidSpecification,
    UnknownMessageType,
    is_valid_constant_name,
    is_valid_field_name,
    is_valid_message_name,
    is_valid_package_name,
)
from bus_ros.rosidl_adapter.specification import (
    ActionSpecification,
    Constant,
    Field,
    MessageSpecification,
    ServiceSpecification,
    validate_field_types,
)
from bus_ros.rosidl_adapter.types import (
    BaseType,
    Type,
)
from bus_ros.rosidl_adapter.values import (
    InvalidValue,
    find_matching_end_quote,
    parse_primitive_value_string,
    parse_string_array_value_string,
    parse_value_string,
)

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
    "ActionSpecification",
    "BaseType",
    "Constant",
    "Field",
    "InvalidActionSpecification",
    "InvalidFieldDefinition",
    "InvalidResourceName",
    "InvalidServiceSpecification",
    "InvalidSpecification",
    "InvalidValue",
    "MessageSpecification",
    "ServiceSpecification",
    "Type",
    "UnknownMessageType",
    "extract_file_level_comments",
    "find_matching_end_quote",
    "is_valid_constant_name",
    "is_valid_field_name",
    "is_valid_message_name",
    "is_valid_package_name",
    "parse_action_file",
    "parse_action_string",
    "parse_message_file",
    "parse_message_string",
    "parse_primitive_value_string",
    "parse_service_file",
    "parse_service_string",
    "parse_string_array_value_string",
    "parse_value_string",
    "process_comments",
    "validate_field_types",
]


def parse_message_file(pkg_name: str, interface_filename: str | Path) -> MessageSpecification:
    """The content of a .msg file; as `parse_message_string`."""
    path = Path(interface_filename)
    return parse_message_string(pkg_name, path.stem, path.read_text("utf-8"))


def parse_message_string(pkg_name: str, msg_name: str, message_string: str) -> MessageSpecification:
    """The content of a message, each field and constant with its comments.

    Raises InvalidFieldDefinition for a type without a name, else as Type, Field, Constant and
    MessageSpecification. Prints the line with such an error to stderr.
    """
    comments, lines = extract_file_level_comments(message_string.replace("\t", " "))
    elements: list[Field | Constant] = []
    above: list[str] = []
    for line in map(str.rstrip, lines):
        code, mark, comment = line.partition(COMMENT_DELIMITER)
        comment = comment.lstrip(COMMENT_DELIMITER)
        if mark and code and not code.strip():  # it is indented: a comment on the element above
            if elements:
                elements[-1].annotations["comment"].append(comment)
            continue
        if mark:
            above.append(comment)
        if code := code.rstrip():
            elements.append(_element(pkg_name, msg_name, code))
            elements[-1].annotations["comment"] = above
            above = []
    message = MessageSpecification(
        pkg_name,
        msg_name,
        [one for one in elements if isinstance(one, Field)],
        [one for one in elements if isinstance(one, Constant)],
    )
    message.annotations["comment"] = comments
    for one in (message, *elements):
        process_comments(one)
    return message


def parse_service_file(pkg_name: str, interface_filename: str | Path) -> ServiceSpecification:
    """The content of a .srv file; as `parse_service_string`."""
    path = Path(interface_filename)
    return parse_service_string(pkg_name, path.stem, path.read_text("utf-8"))


def parse_service_string(pkg_name: str, srv_name: str, message_string: str) -> ServiceSpecification:
    """The content of a service. Raises InvalidServiceSpecification if it has not two parts."""
    separator = SERVICE_REQUEST_RESPONSE_SEPARATOR
    parts = _split(message_string, separator)
    if len(parts) != 2:
        what = "separator" if len(parts) == 1 else "unique separator"
        raise InvalidServiceSpecification(f"Could not find {what} '{separator}' between request and response")
    suffixes = SERVICE_REQUEST_MESSAGE_SUFFIX, SERVICE_RESPONSE_MESSAGE_SUFFIX
    request, response = (
        parse_message_string(pkg_name, srv_name + suffix, part)
        for suffix, part in zip(suffixes, parts, strict=True)
    )
    return ServiceSpecification(pkg_name, srv_name, request, response)


def parse_action_file(pkg_name: str, interface_filename: str | Path) -> ActionSpecification:
    """The content of an .action file; as `parse_action_string`."""
    path = Path(interface_filename)
    return parse_action_string(pkg_name, path.stem, path.read_text("utf-8"))


def parse_action_string(pkg_name: str, action_name: str, action_string: str) -> ActionSpecification:
    """The content of an action. Raises InvalidActionSpecification if it has not three parts."""
    parts = _split(action_string, ACTION_REQUEST_RESPONSE_SEPARATOR)
    if len(parts) != 3:
        raise InvalidActionSpecification(
            f"Number of '{ACTION_REQUEST_RESPONSE_SEPARATOR}' separators nonconformant with action definition"
        )
    suffixes = ACTION_GOAL_SUFFIX, ACTION_RESULT_SUFFIX, ACTION_FEEDBACK_SUFFIX
    goal, result, feedback = (
        parse_message_string(pkg_name, action_name + suffix, part)
        for suffix, part in zip(suffixes, parts, strict=True)
    )
    return ActionSpecification(pkg_name, action_name, goal, result, feedback)


def _element(package: str, message: str, code: str) -> Field | Constant:
    type_text, _, rest = code.partition(" ")
    rest = rest.lstrip()
    if not rest:
        print("Error with:", package, message, code, file=sys.stderr)
        raise InvalidFieldDefinition(code)
    name, is_constant, value = rest.partition(CONSTANT_SEPARATOR)
    if is_constant:
        return Constant(type_text, name.rstrip(), value.lstrip())
    name, _, value = rest.partition(" ")
    try:
        return Field(Type(type_text, context_package_name=package), name, value.lstrip() or None)
    except Exception as error:
        print(f"Error processing '{code}' of '{package}/{message}': '{error}'", file=sys.stderr)
        raise


def _split(text: str, separator: str) -> list[str]:
    """The parts between the lines that are exactly `separator`."""
    parts: list[list[str]] = [[]]
    for line in text.splitlines():
        if line == separator:
            parts.append([])
        else:
            parts[-1].append(line)
    return ["\n".join(part) for part in parts]
