"""Names, exceptions and type checks of the facade, in rclpy's words."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from bus.msg.std_msgs import String
from bus_ros.rclpy import exceptions
from bus_ros.rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidParameterException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    NameValidationException,
)
from bus_ros.rclpy.type_hash import TypeHash
from bus_ros.rclpy.type_support import (
    check_for_type_support,
    check_is_valid_msg_type,
    check_is_valid_srv_type,
)
from bus_ros.rclpy.validate_topic_name import (
    expand_topic_name,
    validate_full_topic_name,
    validate_namespace,
    validate_node_name,
    validate_parameter_name,
    validate_topic_name,
)
from bus_ros.rosidl import message_class, service_class
from rows import for_each


def test_names_that_are_right() -> None:
    assert validate_topic_name("~/chatter")
    assert validate_topic_name("add_two_ints", is_service=True)
    assert validate_full_topic_name("/ns/chatter")
    assert validate_node_name("talker")
    assert validate_namespace("/ns")
    assert validate_parameter_name("a.b")
    assert expand_topic_name("~/x", "talker", "/ns") == "/ns/talker/x"


@for_each(
    ("check", "name", "error", "text"),
    [
        (
            validate_topic_name,
            "bad name",
            InvalidTopicNameException,
            "Invalid topic name: topic name must not contain characters other than alphanumerics,"
            " '_', '~', '{', or '}':\n  'bad name'\n      ^",
        ),
        (
            lambda name: validate_topic_name(name, is_service=True),
            "bad name",
            InvalidServiceNameException,
            "Invalid service name: topic name must not contain characters other than alphanumerics,"
            " '_', '~', '{', or '}':\n  'bad name'\n      ^",
        ),
        (
            validate_full_topic_name,
            "x",
            InvalidTopicNameException,
            "Invalid topic name: topic name must be absolute, it must lead with a '/':\n  'x'\n   ^",
        ),
        (
            lambda name: validate_full_topic_name(name, is_service=True),
            "/a//b",
            InvalidServiceNameException,
            "Invalid service name: topic name must not contain repeated '/':\n  '/a//b'\n      ^",
        ),
        (
            validate_node_name,
            "my-node",
            InvalidNodeNameException,
            "Invalid node name: node name must not contain characters other than alphanumerics or '_':\n"
            "  'my-node'\n     ^",
        ),
        (
            validate_namespace,
            "/ns/",
            InvalidNamespaceException,
            "Invalid namespace: namespace must not end with a '/', unless only a '/':\n  '/ns/'\n      ^",
        ),
        (validate_parameter_name, "", InvalidParameterException, "Invalid parameter name: "),
    ],
)
def test_names_that_are_wrong(
    check: Callable[[str], bool], name: str, error: type[Exception], text: str
) -> None:
    with pytest.raises(error) as found:
        check(name)
    assert str(found.value) == text
    assert isinstance(found.value, NameValidationException) or error is InvalidParameterException


def test_expansion_of_a_wrong_name() -> None:
    with pytest.raises(ValueError, match="unknown substitution"):
        expand_topic_name("{other}/x", "talker", "/")


@for_each(
    ("error", "text"),
    [
        (exceptions.NotInitializedException(), "rclpy.init() has not been called."),
        (exceptions.NotInitializedException("here"), "rclpy.init() has not been called. msg:here"),
        (exceptions.ROSInterruptException(), "rclpy.shutdown() has been called"),
        (exceptions.NoTypeSupportImportedException(), "no type_support imported"),
        (
            exceptions.ParameterNotDeclaredException("speed"),
            "Invalid access to undeclared parameter(s): speed",
        ),
        (
            exceptions.ParameterAlreadyDeclaredException(["a", "b"]),
            "Parameter(s) already declared: ['a', 'b']",
        ),
        (
            exceptions.ParameterImmutableException("speed"),
            "Attempted to modify read-only parameter: speed",
        ),
        (
            exceptions.ParameterUninitializedException("speed"),
            "The parameter 'speed' is not initialized: speed",
        ),
        (
            exceptions.InvalidParameterValueException("speed", 9, "too fast"),
            "Invalid parameter value (9) for parameter. Reason: too fast: speed",
        ),
        (
            exceptions.InvalidParameterTypeException(
                SimpleNamespace(name="speed", value=9, type_=SimpleNamespace(name="INTEGER")), "DOUBLE"
            ),
            "Trying to set parameter 'speed' to '9' of type 'INTEGER', expecting type 'DOUBLE': speed",
        ),
    ],
)
def test_texts_of_exceptions(error: Exception, text: str) -> None:
    assert str(error) == text


def test_which_exception_is_which() -> None:
    assert issubclass(exceptions.RCLError, RuntimeError)
    assert issubclass(exceptions.InvalidHandle, RuntimeError)
    assert issubclass(exceptions.RCLInvalidROSArgsError, exceptions.RCLError)
    assert issubclass(exceptions.ParameterNotDeclaredException, exceptions.ParameterException)
    assert [name for name in exceptions.__all__ if not hasattr(exceptions, name)] == []


def test_message_and_service_classes() -> None:
    text, request = message_class("std_msgs/msg/String"), message_class("std_srvs/srv/SetBool_Request")
    check_is_valid_msg_type(text)
    check_is_valid_msg_type(request)
    check_is_valid_msg_type(String)
    check_is_valid_srv_type(service_class("std_srvs/srv/SetBool"))
    with pytest.raises(RuntimeError, match=r"The message type provided is not valid .* service or action"):
        check_is_valid_msg_type(service_class("std_srvs/srv/SetBool"))
    with pytest.raises(RuntimeError, match=r"The service type provided is not valid .* message or action"):
        check_is_valid_srv_type(text)


@pytest.mark.parametrize(("wrong", "text"), [(str, "type object 'str'"), ("std_msgs", "type object 'str'")])
def test_what_is_neither(wrong: Any, text: str) -> None:
    with pytest.raises(AttributeError, match=f"{text} has no attribute '_TYPE_SUPPORT'.*ROS 1 message type"):
        check_for_type_support(wrong)


def test_type_hashes() -> None:
    text = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    known = TypeHash.parse(text)
    assert (str(known), known.version, known.value[:1]) == (text, 1, b"\xdf")
    assert known == TypeHash(1, known.value) != TypeHash()
    assert str(TypeHash()) == str(TypeHash.parse("BUS01_00")) == str(TypeHash.parse("RIHS01_x")) == "INVALID"
