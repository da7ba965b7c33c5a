"""Classes by name."""

from typing import Any

import pytest

from bus_ros.rosidl import action_class, message_class, service_class, utilities
from bus_ros.rosidl.definition import NamespacedType, UnboundedSequence
from rows import for_each

STRING = message_class("std_msgs/msg/String")
FIBONACCI = action_class("example_interfaces/action/Fibonacci")
SET_BOOL = service_class("std_srvs/srv/SetBool")


def test_classes_by_name() -> None:
    assert utilities.get_message("std_msgs/msg/String") is STRING
    assert utilities.get_interface("std_msgs/String") is utilities.get_message("std_msgs/String") is STRING
    assert utilities.get_service("std_srvs/srv/SetBool") is SET_BOOL
    assert utilities.get_service("std_srvs/SetBool") is SET_BOOL
    assert utilities.get_action("example_interfaces/Fibonacci") is FIBONACCI


@for_each(
    "name",
    [
        "std_srvs/srv/SetBool_Request",
        "std_srvs/srv/SetBool_Event",
        "example_interfaces/action/Fibonacci_Goal",
        "example_interfaces/action/Fibonacci_FeedbackMessage",
    ],
)
def test_messages_of_services_and_actions(name: str) -> None:
    assert utilities.get_message(name) is utilities.get_interface(name) is message_class(name)


def test_kinds() -> None:
    every = STRING, SET_BOOL, FIBONACCI
    assert [utilities.is_message(one) for one in every] == [True, False, False]
    assert [utilities.is_service(one) for one in every] == [False, True, False]
    assert [utilities.is_action(one) for one in every] == [False, False, True]


def test_names_as_types() -> None:
    for get, kind in (
        (utilities.get_message_namespaced_type, "msg"),
        (utilities.get_service_namespaced_type, "srv"),
        (utilities.get_action_namespaced_type, "action"),
    ):
        assert get("any_msgs/Any") == get(f"any_msgs/{kind}/Any") == NamespacedType(["any_msgs", kind], "Any")
    assert utilities.get_namespaced_type("any_msgs/Any") == NamespacedType(["any_msgs"], "Any")
    string = utilities.get_message_namespaced_type("std_msgs/String")
    assert utilities.import_message_from_namespaced_type(string) is STRING
    with pytest.warns(DeprecationWarning, match="pass its value_type"):
        assert utilities.import_message_from_namespaced_type(UnboundedSequence(string)) is STRING


@for_each(
    ("get", "name", "kind", "text"),
    [
        (utilities.get_message, "std_srvs/srv/SetBool", ValueError, "full name of a message, got 'std_srvs/"),
        (utilities.get_service, "std_msgs/msg/String", ValueError, "full name of a service, got 'std_msgs/m"),
        (utilities.get_action, "std_msgs/msg/String", ValueError, "full name of an action, got 'std_msgs/"),
        (utilities.get_interface, "String", ValueError, "full name of an interface, got 'String'"),
        (utilities.get_interface, "std_msgs/other/String", ValueError, "full name of an interface"),
        (utilities.get_message, "std_msgs/msg/Strin", AttributeError, "module 'std_msgs.msg' has no attribu"),
        (utilities.get_message, "std_srvs/srv/SetBool_Req", AttributeError, "no attribute 'SetBool_Req'"),
        (utilities.get_message, "no_msgs/msg/A", ModuleNotFoundError, "No module named 'no_msgs'"),
    ],
)
def test_unknown_names(get: Any, name: str, kind: type[Exception], text: str) -> None:
    with pytest.raises(kind, match=text):
        get(name)
