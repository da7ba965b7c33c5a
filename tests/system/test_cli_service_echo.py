"""`bus service echo`: the events of services, against the texts of the real `ros2`."""

import re
import signal
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from cli import Result, Running, bus, start

PROGRAM = """
import rclpy
from example_interfaces.srv import AddTwoInts
from rclpy.qos import qos_profile_system_default
from rclpy.service_introspection import ServiceIntrospectionState

def add(request, response):
    response.sum = request.a + request.b
    return response

rclpy.init()
node = rclpy.create_node("adder")
service = node.create_service(AddTwoInts, "add_two_ints", add)
client = node.create_client(AddTwoInts, "add_two_ints")
for end in (service, client):
    end.configure_introspection(
        node.get_clock(), qos_profile_system_default, ServiceIntrospectionState.CONTENTS
    )
node.create_timer(0.1, lambda: client.call_async(AddTwoInts.Request(a=1, b=2)))
print("ready", flush=True)
rclpy.spin(node)
"""
TYPE = "example_interfaces/srv/AddTwoInts"
TOPIC = "/add_two_ints/_service_event"
GID = "  client_gid:\n(  - \\d+\n){{16}}"
STAMP = "  stamp:\n    sec: \\d+\n    nanosec: \\d+\n"
EVENT = "info:\n  event_type: {}\n" + STAMP + GID + "  sequence_number: \\d+\nrequest:{}\nresponse:{}\n---\n"


@pytest.fixture
def adder(daemon: object, tmp_path: Path) -> Iterator[Running]:
    path = tmp_path / "adder.py"
    path.write_text(PROGRAM)
    with Running(("-m", "bus_cli", "run", "--force", str(path))) as running:
        assert running.line() == "ready"
        yield running


def event_after(echo: Running, kind: str) -> str:
    """The next event of a kind, up to its end."""
    line = echo.line_with(f"event_type: {kind}")
    lines = ["info:", line]
    while line != "---":
        lines.append(line := echo.line())
    return "".join(f"{line}\n" for line in lines)


@pytest.mark.parametrize("type_name", [(), (TYPE,), ("example_interfaces/AddTwoInts",)])
def test_yaml(adder: Running, type_name: tuple[str, ...]) -> None:
    with start("service", "echo", "add_two_ints", *type_name) as echo:
        for kind, request, response in (
            ("REQUEST_SENT", "\n- a: 1\n  b: 2", " \\[\\]"),
            ("REQUEST_RECEIVED", "\n- a: 1\n  b: 2", " \\[\\]"),
            ("RESPONSE_SENT", " \\[\\]", "\n- sum: 3"),
            ("RESPONSE_RECEIVED", " \\[\\]", "\n- sum: 3"),
        ):
            assert re.fullmatch(EVENT.format(kind, request, response), event_after(echo, kind))
        assert echo.end(signal.SIGINT).code == -signal.SIGINT


def test_other_formats(adder: Running) -> None:
    with start("service", "echo", "/add_two_ints", "--csv") as echo:
        assert re.fullmatch(r"0,\d+,\d+,(\d+,){16}\d+,1,2", echo.line_with("^0,"))
        assert re.fullmatch(r"2,\d+,\d+,(\d+,){16}\d+,3", echo.line_with("^2,"))
    with start("service", "echo", "/add_two_ints", "--json", "--csv") as echo:  # as in topic echo
        record = msgspec.json.decode(echo.line_with("RESPONSE_SENT"))
        assert record["info"]["event_type"] == "RESPONSE_SENT"
        assert (record["request"], record["response"]) == ([], [{"sum": 3}])
    with start("service", "echo", "/add_two_ints", "--no-arr") as echo:
        event = event_after(echo, "REQUEST_SENT")
    assert "  client_gid: '<array type: uint8[16]>'\n" in event
    assert event.endswith(
        f"request: '<sequence type: {TYPE}_Request[1], length: 1>'\n"
        f"response: '<sequence type: {TYPE}_Response[1], length: 0>'\n---\n"
    )
    with start("service", "echo", "/add_two_ints", "-l", "1") as echo:
        assert re.search(
            "  client_gid:\n  - \\d+\n  - '?\\.\\.\\.'?\n  seq", event_after(echo, "REQUEST_SENT")
        )


def test_a_service_that_publishes_no_events(daemon: object) -> None:
    with start("service", "echo", "add_two_ints", TYPE) as echo:
        assert echo.error_line() == (
            f"No publishers on topic '{TOPIC}'; is service introspection on the client or server enabled?"
        )
        assert echo.end(signal.SIGTERM).code == -signal.SIGTERM


def test_events_that_begin_later(daemon: object, tmp_path: Path) -> None:
    path = tmp_path / "adder.py"
    path.write_text(PROGRAM)
    with start("service", "echo", "add_two_ints", TYPE) as echo:
        assert echo.error_line().startswith("No publishers on topic")
        with Running(("-m", "bus_cli", "run", "--force", str(path))):
            assert event_after(echo, "RESPONSE_RECEIVED").endswith("\nresponse:\n- sum: 3\n---\n")


def test_what_can_not_be(adder: Running) -> None:
    none = "Cannot find type for '/ad_two_ints'; did you mean '/add_two_ints'?\n"
    assert bus("service", "echo", "ad_two_ints") == Result("", none, 1)
    assert bus("service", "echo", "nosuch") == Result("", "Cannot find type for '/nosuch'\n", 1)
    invalid = f"The passed service type is invalid; did you mean '{TYPE}'?\n"
    assert bus("service", "echo", "add_two_ints", "AddTwoInts") == Result("", invalid, 1)
    unknown = "Could not load the type for the passed service: unknown interface 'demo/srv/No'\n"
    assert bus("service", "echo", "nosuch", "demo/No") == Result("", unknown, 1)
