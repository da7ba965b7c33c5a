"""Errors in one line for unknown names: of the library, of its packages, of a message's fields."""

import asyncio
import subprocess
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

import bus
from bus.base.missing_names import explain_unknown_field
from bus.errors import ConfigurationError
from bus.msg import std_msgs
from bus.msg.geometry_msgs import Point
from bus.msg.std_msgs import String
from bus.qos import profile


@pytest.mark.parametrize(
    ("module", "name", "text"),
    [
        (bus, "Nodes", "module 'bus' has no 'Nodes'; did you mean 'Node'?"),
        (bus, "elephant", "module 'bus' has no 'elephant'"),
        (
            bus,
            "spin",
            "module 'bus' has no 'spin', which is rclpy's: write await node.spin() in async def main()",
        ),
        (bus.msg, "std_msg", "module 'bus.msg' has no 'std_msg'; did you mean 'std_msgs'?"),
        (bus.srv, "std_srv", "module 'bus.srv' has no 'std_srv'; did you mean 'std_srvs'?"),
    ],
)
def test_of_a_module(module: ModuleType, name: str, text: str) -> None:
    with pytest.raises(AttributeError) as looked_up:
        getattr(module, name)
    assert str(looked_up.value) == text
    with pytest.raises(ImportError) as imported:
        exec(f"from {module.__name__} import {name}")
    assert str(imported.value) == text
    assert not hasattr(module, f"__{name}__")


def test_packages_are_there_when_they_are_asked_for() -> None:
    program = "import bus; print(bus.msg.std_msgs.String.__name__, bus.srv.std_srvs.Empty.__name__)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "String Empty\n"


@pytest.mark.parametrize(
    ("make", "notes"),
    [
        (lambda: String(dta="x"), ["fields of String: data; did you mean 'data'?"]),  # type: ignore[call-arg]
        (lambda: std_msgs.String(dta="x"), ["fields of String: data; did you mean 'data'?"]),  # type: ignore[call-arg]
        (lambda: String(elephant=1), ["fields of String: data"]),  # type: ignore[call-arg]
        (
            lambda: (String(), Point(xx=1.0)),  # type: ignore[call-arg]
            ["fields of Point: x, y, z; did you mean 'x'?"],
        ),
        (lambda: (String(), Point(elephant=1.0)), None),  # type: ignore[call-arg]
        (lambda: int("1", bse=2), None),  # type: ignore[call-overload]
    ],
)
def test_of_a_message(make: Callable[[], Any], notes: list[str] | None) -> None:
    with pytest.raises(TypeError) as raised:
        make()
    explain_unknown_field(raised.value)
    assert getattr(raised.value, "__notes__", None) == notes


def test_of_a_message_in_a_program() -> None:
    async def main() -> None:
        String(dta="x")  # type: ignore[call-arg]

    with pytest.raises(TypeError) as raised:
        bus.run(main())
    assert raised.value.__notes__ == ["fields of String: data; did you mean 'data'?"]


def test_a_depth_that_is_a_text() -> None:
    with pytest.raises(ConfigurationError, match=r"^QoS '10' is a text: for a depth, write the int 10$"):
        profile("10")


def test_a_plain_with() -> None:
    async def main() -> None:
        with bus.Node("talker", arguments=[]):  # type: ignore[call-arg]
            pass

    with pytest.raises(TypeError) as raised:
        asyncio.run(main())
    assert str(raised.value) == (
        "write async with bus.Node('talker') as node, in async def main(); or, in a script without asyncio, "
        "with bus.connect('talker') as node"
    )
