"""`bus service`, against the texts of the real `ros2`."""

import signal
from collections.abc import Iterator

import msgspec
import pytest

from bus_cli.completion import topics
from bus_cli.main import make_parser
from bus_cli.service.definitions import services
from cli import Result, bus, script, start, words

SERVER = """
import asyncio, bus
from bus.srv.example_interfaces import AddTwoInts

def add(request):
    if request.a < 0:
        raise ValueError("too small")
    return AddTwoInts.Response(sum=request.a + request.b)

async def main():
    async with bus.Node("adder", arguments=[]) as node:
        await node.create_service(AddTwoInts, "add_two_ints", add)
        await node.create_service(AddTwoInts, "_hidden", add)
        await node.create_client(AddTwoInts, "elsewhere")
        print("ready", flush=True)
        await asyncio.Event().wait()

try:
    bus.run(main())
except ValueError:
    pass
"""
OWN = """
import asyncio, bus, msgspec
from bus.msg import Message, string
from bus.msg.geometry_msgs import Point

class Move(bus.Service):
    __type_name__ = "demo/srv/Move"
    class Request(Message, kw_only=True):
        to: Point = msgspec.field(default_factory=Point)
    class Response(Message, kw_only=True):
        text: string = ""

async def main():
    async with bus.Node("mover", arguments=[]) as node:
        await node.create_service(Move, "move", lambda request: Move.Response(text=f"at {request.to.x}"))
        print("ready", flush=True)
        await asyncio.Event().wait()

bus.run(main())
"""
TYPE = "example_interfaces/srv/AddTwoInts"
MAKING = "requester: making request: example_interfaces.srv.AddTwoInts_Request"
ANSWER = "\nresponse:\nexample_interfaces.srv.AddTwoInts_Response"

GOLDEN = {
    "service list": "/add_two_ints\n/elsewhere\n",
    "service list -t": f"/add_two_ints [{TYPE}]\n/elsewhere [{TYPE}]\n",
    "service list -c": "2\n",
    "service list --include-hidden-services": "/_hidden\n/add_two_ints\n/elsewhere\n",
    "service list --include-hidden-services -c": "3\n",
    "service list -c --json": '{"count":2}\n',
    "service list --json": f'{{"service":"/add_two_ints","types":["{TYPE}"],"servers":1,"clients":0}}\n'
    f'{{"service":"/elsewhere","types":["{TYPE}"],"servers":0,"clients":1}}\n',
    "service type /add_two_ints": f"{TYPE}\n",
    "service type add_two_ints": f"{TYPE}\n",
    "service type add_two_ints --json": f'{{"service":"/add_two_ints","type":"{TYPE}"}}\n',
    f"service find {TYPE}": "/add_two_ints\n/elsewhere\n",
    "service find example_interfaces/AddTwoInts -c": "2\n",
    "service find example_interfaces/AddTwoInts -c --json": '{"count":2}\n',
    f"service find {TYPE} --include-hidden-services": "/_hidden\n/add_two_ints\n/elsewhere\n",
    "service find std_srvs/srv/Empty": "",
    "service info /add_two_ints": f"Type: {TYPE}\nClients count: 0\nServices count: 1\n",
    "service info elsewhere": f"Type: {TYPE}\nClients count: 1\nServices count: 0\n",
    "service info elsewhere --json": f'{{"service":"/elsewhere","types":["{TYPE}"],"clients_count":1,'
    '"services_count":0}\n',
    f"service call /add_two_ints {TYPE}": f"{MAKING}(a=0, b=0)\n{ANSWER}(sum=0)\n\n",
    "service call add_two_ints example_interfaces/AddTwoInts {a:1,b:2}": f"{MAKING}(a=1, b=2)\n"
    f"{ANSWER}(sum=3)\n\n",
    "service call add_two_ints example_interfaces/AddTwoInts {a:1} --json": '{"response":{"sum":1}}\n',
    "topic list": "/rosout\n",
    "topic list --include-hidden-topics": "/_hidden/_reply\n/_hidden/_request\n"
    "/add_two_ints/_reply\n/add_two_ints/_request\n/elsewhere/_reply\n/elsewhere/_request\n/rosout\n",
    f"topic find {TYPE}_Request": "",
    f"topic find {TYPE}_Request --include-hidden-topics -c": "3\n",
    "node info /adder": "/adder\n"
    "  Subscribers:\n"
    "\n"
    "  Publishers:\n"
    "    /rosout: rcl_interfaces/msg/Log\n"
    "  Service Servers:\n"
    f"    /add_two_ints: {TYPE}\n"
    "  Service Clients:\n"
    f"    /elsewhere: {TYPE}\n"
    "  Action Servers:\n"
    "\n"
    "  Action Clients:\n"
    "\n",
}

INVALID = "The passed service type is invalid"
NO_FIELD = "Failed to populate field: "
REFUSED = {
    "service info nosuch": "Unknown service 'nosuch'\n",
    "service find AddTwoInts": f"{INVALID}; did you mean '{TYPE}'?\n",
    "service call add_two_ints AddTwoInts": f"{INVALID}; did you mean '{TYPE}'?\n",
    "service info ad_two_ints": "Unknown service 'ad_two_ints'; did you mean '/add_two_ints'?\n",
    "service type ad_two_ints": "Unknown service 'ad_two_ints'; did you mean '/add_two_ints'?\n",
    "service call add_two_ints std_msgs/msg/String": (
        f"{INVALID}: std_msgs/msg/String is a message, not a service\n"
    ),
    "service call add_two_ints std_srvs/Empty": (
        f"service '/add_two_ints' has the type {TYPE}, not std_srvs/srv/Empty\n"
    ),
    f"service call add_two_ints {TYPE} 3": "The passed value needs to be a dictionary in YAML format\n",
    f"service call add_two_ints {TYPE} {{c:1}}": (
        f"{NO_FIELD}'AddTwoInts_Request' object has no attribute 'c'\n"
    ),
    f"service call add_two_ints {TYPE} {{a:x}}": (f"{NO_FIELD}'a' takes int64, not 'x'\n"),
}


@pytest.fixture
def adder(daemon: object) -> Iterator[None]:
    with script(SERVER):
        yield


def test_what_is_there(adder: None) -> None:
    assert {line: bus(*words(line)) for line in GOLDEN} == {
        line: Result(out, "", 0) for line, out in GOLDEN.items()
    }


def test_what_can_not_be(adder: None) -> None:
    assert {line: bus(*words(line)) for line in REFUSED} == {
        line: Result("", text, 1) for line, text in REFUSED.items()
    }
    assert bus("service", "type", "nosuch") == Result("", "", 1)
    with start("service", "call", "ad_two_ints", TYPE) as call:
        assert call.line() == "waiting for service to become available..."
        assert call.error_line() == "no server for '/ad_two_ints'; did you mean '/add_two_ints'?"
    broken = bus("service", "call", "add_two_ints", TYPE, "{a: [}")
    assert (broken.out, broken.code) == ("", 1)
    assert broken.err.startswith("The passed value needs to be a dictionary in YAML format: ")
    unknown = bus("service", "call", "nosuch", "demo/Nonsense")
    assert (unknown.out, unknown.code) == ("", 1)
    assert unknown.err.startswith("The passed service type is invalid: unknown interface 'demo/srv/Nonsense'")


def test_a_request_from_the_standard_input(adder: None) -> None:
    words = ("service", "call", "add_two_ints", TYPE)
    answer = Result(f"{MAKING}(a=1, b=2)\n{ANSWER}(sum=3)\n\n", "", 0)
    assert bus(*words, "--stdin", stdin="a: 1\nb: 2\n") == answer
    assert bus(*words, "--stdin", stdin='{"a": 1, "b": 2}') == answer
    broken = bus(*words, "--stdin", stdin="a: 1\n---\na: 2\n")
    assert (broken.out, broken.code) == ("", 1)
    assert broken.err.startswith("The passed value needs to be a dictionary in YAML format: ")
    both = bus(*words, "{a: 1}", "--stdin")
    assert (both.out, both.code) == ("", 2)
    assert both.err.endswith("error: argument --stdin: not allowed with argument values\n")


def test_node_info_as_json(adder: None) -> None:
    record = msgspec.json.decode(bus("node", "info", "adder", "--json").out)
    assert record["service_servers"] == {"/add_two_ints": [TYPE]}
    assert record["service_clients"] == {"/elsewhere": [TYPE]}


def test_a_server_that_raises(adder: None) -> None:
    result = bus("service", "call", "add_two_ints", TYPE, "{a: -1}")
    assert result == Result(
        f"{MAKING}(a=-1, b=0)\n\n", "service '/add_two_ints' failed: ValueError: too small\n", 1
    )


def test_types_that_only_the_bus_knows(daemon: object) -> None:
    with script(OWN):
        result = bus("service", "call", "move", "demo/Move", "{to: {x: 2}}")
    assert result.err == ""
    assert result.out == (
        "requester: making request: "
        "demo.srv.Move_Request(to=geometry_msgs.msg.Point(x=2.0, y=0.0, z=0.0))\n\n"
        "response:\ndemo.srv.Move_Response(text='at 2.0')\n\n"
    )


def test_waiting_for_the_service(daemon: object) -> None:
    with start("service", "call", "add_two_ints", TYPE, "{a: 40, b: 2}") as caller:
        assert caller.line() == "waiting for service to become available..."
        with script(SERVER):
            assert caller.line() == f"{MAKING}(a=40, b=2)"
            assert caller.end() == Result(f"{ANSWER}(sum=42)\n\n", "", 0)


def test_again_and_again(adder: None) -> None:
    with start("service", "call", "add_two_ints", TYPE, "a: 1", "--rate", "100") as caller:
        assert caller.lines(10) == f"{MAKING}(a=1, b=0)\n{ANSWER}(sum=1)\n\n" * 2
        assert caller.end(signal.SIGINT).code == -signal.SIGINT


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ended_by_a_signal(daemon: object, number: signal.Signals) -> None:
    with start("service", "call", "nowhere", TYPE) as caller:
        assert caller.line() == "waiting for service to become available..."
        assert caller.end(number) == Result("", "", -number)


def test_completion(adder: None) -> None:
    args = make_parser(["service", "type"]).parse_args(["service", "type", "x"])
    assert services("", args) == ["/add_two_ints", "/elsewhere"]
    assert services("/_", args) == ["/_hidden", "/add_two_ints", "/elsewhere"]
    assert topics("", args) == ["/rosout"]
