"""`bus action`, against the texts of the real `ros2`."""

import re
import signal
from collections.abc import Iterator

import msgspec
import pytest

from bus_actions.client import ActionClient
from bus_cli.action.definitions import action_types, actions
from bus_cli.main import make_parser
from cli import Result, bus, script, start, words

SERVER = """
import asyncio, bus
from bus_actions import ActionClient, ActionServer, find_action

Fibonacci = find_action("example_interfaces/action/Fibonacci")

async def execute(goal):
    sequence = [0, 1]
    for _ in range(1, goal.request.order):
        sequence.append(sequence[-1] + sequence[-2])
        yield Fibonacci.Feedback(sequence=sequence)
        if goal.request.order == 99:
            await asyncio.sleep(1000)
    if goal.request.order == 50:
        goal.abort()
    yield Fibonacci.Result(sequence=sequence)

async def main():
    async with bus.Node("fibonacci_action_server", arguments=[]) as node, bus.Node("other") as other:
        async with (
            ActionServer(node, Fibonacci, "fibonacci", execute, goal_callback=lambda goal: goal.order < 100),
            ActionClient(other, Fibonacci, "fibonacci"),
            ActionClient(other, Fibonacci, "elsewhere"),
        ):
            print("ready", flush=True)
            await node.spin()

bus.run(main())
"""
OWN = """
import bus
from bus.msg import Message, float64
from bus_actions import Action, ActionServer

class Move(Action):
    __type_name__ = "demo/action/Move"
    class Goal(Message, kw_only=True):
        to: float64 = 0.0
    class Result(Message, kw_only=True):
        at: float64 = 0.0
    class Feedback(Message, kw_only=True):
        left: float64 = 0.0

async def execute(goal):
    yield Move.Feedback(left=goal.request.to)
    yield Move.Result(at=goal.request.to)

async def main():
    async with bus.Node("mover", arguments=[]) as node, ActionServer(node, Move, "move", execute):
        print("ready", flush=True)
        await node.spin()

bus.run(main())
"""
TYPE = "example_interfaces/action/Fibonacci"
NEAR = "action_tutorials_interfaces/action/Fibonacci"
"""The first type of that short name."""
INFO = "Action: /fibonacci\nAction clients: 1\n{}Action servers: 1\n{}"
GOLDEN = {
    "action list": "/elsewhere\n/fibonacci\n",
    "action list -t": f"/elsewhere [{TYPE}]\n/fibonacci [{TYPE}]\n",
    "action list -c": "2\n",
    "action list -c --json": '{"count":2}\n',
    "action list --json": f'{{"action":"/elsewhere","types":["{TYPE}"],"servers":0,"clients":1}}\n'
    f'{{"action":"/fibonacci","types":["{TYPE}"],"servers":1,"clients":1}}\n',
    f"action find {TYPE}": "/elsewhere\n/fibonacci\n",
    "action find example_interfaces/Fibonacci -c": "2\n",
    "action find example_interfaces/Fibonacci -c --json": '{"count":2}\n',
    "action find turtlesim/action/RotateAbsolute": "",
    "action type /fibonacci": f"{TYPE}\n",
    "action type fibonacci --json": f'{{"action":"/fibonacci","type":"{TYPE}"}}\n',
    "action info /fibonacci": INFO.format("    /other\n", "    /fibonacci_action_server\n"),
    "action info /fibonacci -t": INFO.format(
        f"    /other [{TYPE}]\n", f"    /fibonacci_action_server [{TYPE}]\n"
    ),
    "action info /fibonacci -c": INFO.format("", ""),
    "action info fibonacci --json": f'{{"action":"/fibonacci","types":["{TYPE}"],"clients":["/other"],'
    '"servers":["/fibonacci_action_server"]}\n',
    "action info /nosuch": "Action: /nosuch\nAction clients: 0\nAction servers: 0\n",
    "topic list": "/rosout\n",
    "service list": "",
    "node info /fibonacci_action_server": "/fibonacci_action_server\n"
    "  Subscribers:\n\n"
    "  Publishers:\n"
    "    /rosout: rcl_interfaces/msg/Log\n"
    "  Service Servers:\n\n"
    "  Service Clients:\n\n"
    "  Action Servers:\n"
    f"    /fibonacci: {TYPE}\n"
    "  Action Clients:\n\n",
}
INVALID = "The passed action type is invalid"
REFUSED = {
    "action send_goal fibonacci Fibonacci {}": f"{INVALID}; did you mean '{NEAR}'?\n",
    "action send_goal fibonacci std_msgs/msg/String {}": (
        f"{INVALID}: std_msgs/msg/String is a message, not an action\n"
    ),
    "action send_goal fibonacci turtlesim/action/RotateAbsolute {}": (
        f"action '/fibonacci' has the type {TYPE}, not turtlesim/action/RotateAbsolute\n"
    ),
    f"action send_goal fibonacci {TYPE} 3": "The passed value needs to be a dictionary in YAML format\n",
    f"action send_goal fibonacci {TYPE} {{c:1}}": (
        "Failed to populate field: 'Fibonacci_Goal' object has no attribute 'c'\n"
    ),
    "action find Fibonacci": f"{INVALID}; did you mean '{NEAR}'?\n",
    "action type fibonaci": "Unknown action 'fibonaci'; did you mean '/fibonacci'?\n",
}
HEAD = "Waiting for an action server to become available...\nSending goal:\n     order: {}\n\n"
ACCEPTED = f"{HEAD}Goal accepted with ID: ID\n\n"


def sequence(*numbers: int) -> str:
    return "    sequence:\n" + "".join(f"- {number}\n" for number in numbers)


@pytest.fixture
def server(daemon: object) -> Iterator[None]:
    with script(SERVER):
        yield


def send_goal(order: int, *more: str) -> Result:
    """The output has ID in place of the goal's id."""
    result = bus("action", "send_goal", "/fibonacci", TYPE, f"{{order: {order}}}", *more)
    return result._replace(out=re.sub(r"[0-9a-f]{32}", "ID", result.out))


def test_what_is_there(server: None) -> None:
    assert {line: bus(*words(line)) for line in GOLDEN} == {
        line: Result(out, "", 0) for line, out in GOLDEN.items()
    }
    hidden = "/_action/feedback\n"
    assert f"/fibonacci{hidden}" in bus("topic", "list", "--include-hidden-topics").out


def test_what_can_not_be(server: None) -> None:
    assert {line: bus(*words(line)) for line in REFUSED} == {
        line: Result("", text, 1) for line, text in REFUSED.items()
    }
    assert bus("action", "type", "nosuch") == Result("", "", 1)
    unknown = bus("action", "send_goal", "nosuch", "demo/Nonsense", "{}")
    assert (unknown.out, unknown.code) == ("", 1)
    assert unknown.err.startswith(f"{INVALID}: unknown interface 'demo/action/Nonsense'")
    wrong = bus("action", "send_goal", "fibonaci", "demo/Nonsense", "{}")
    assert wrong == Result("", "no server for '/fibonaci'; did you mean '/fibonacci'?\n", 1)
    assert bus("action", "find", "example_interfaces/Fibonaci") == Result(
        "", f"no action has the type 'example_interfaces/action/Fibonaci'; did you mean '{TYPE}'?\n", 0
    )
    with start("action", "send_goal", "fibonaci", TYPE, "{}") as sending:
        assert sending.line() == "Waiting for an action server to become available..."
        assert sending.error_line() == "no server for '/fibonaci'; did you mean '/fibonacci'?"


def test_a_server_that_is_up_is_no_mistake(daemon: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even if its client, just opened, is not ready yet, and another action has a similar name."""
    monkeypatch.setattr(ActionClient, "server_is_ready", lambda _: False)
    with script(OWN.replace('"move", execute)', '"m1", execute), ActionServer(node, Move, "m2", execute)')):
        for action in ("/m1", "/m2"):
            result = bus("action", "send_goal", action, "demo/Move", "{to: 2}")
            assert (result.err, result.code) == ("", 0)


def test_a_goal(server: None) -> None:
    end = f"Result:\n{sequence(0, 1, 1)}\nGoal finished with status: SUCCEEDED\n"
    assert send_goal(2) == Result(f"{ACCEPTED.format(2)}{end}", "", 0)
    feedback = f"Feedback:\n{sequence(0, 1, 1)}\n"
    assert send_goal(2, "-f") == Result(f"{ACCEPTED.format(2)}{feedback}{end}", "", 0)
    assert send_goal(2, "--feedback", "--json").out == (
        '{"accepted":true,"goal_id":"ID"}\n'
        '{"feedback":{"sequence":[0,1,1]}}\n'
        '{"result":{"sequence":[0,1,1]},"status":"SUCCEEDED"}\n'
    )


def test_a_goal_from_the_standard_input(server: None) -> None:
    words = ("action", "send_goal", "/fibonacci", TYPE)
    assert "\n     order: 1\n" in bus(*words, "--stdin", stdin="{order: 1}\n").out
    assert "\n     order: 0\n" in bus(*words).out
    both = bus(*words, "{order: 1}", "--stdin")
    assert (both.out, both.code) == ("", 2)
    assert both.err.endswith("error: argument --stdin: not allowed with argument goal\n")


def test_a_goal_that_comes_to_nothing(server: None) -> None:
    assert send_goal(100) == Result(f"{HEAD.format(100)}Goal was rejected.\n", "", 1)
    aborted = send_goal(50)
    assert aborted.out.endswith("\nGoal finished with status: ABORTED\n")
    assert aborted.code == 1


def test_interrupted_it_cancels_the_goal(server: None) -> None:
    with start("action", "send_goal", "/fibonacci", TYPE, "{order: 99}", "-f") as sending:
        sending.line_with("Feedback:")
        sending.process.send_signal(signal.SIGINT)
        sending.line_with("Canceling goal...")
        assert sending.line() == "Goal canceled."
        assert sending.process.wait() == -signal.SIGINT


def test_types_that_only_the_bus_knows(daemon: object) -> None:
    with script(OWN):
        result = bus("action", "send_goal", "move", "demo/Move", "{to: 2}", "-f", "--json")
    assert result.err == ""
    lines = [msgspec.json.decode(line) for line in result.out.splitlines()]
    assert lines[1:] == [{"feedback": {"left": 2.0}}, {"result": {"at": 2.0}, "status": "SUCCEEDED"}]


def test_completion(server: None) -> None:
    args = make_parser(["action", "send_goal"]).parse_args(["action", "send_goal", "/fibonacci", "x", "{}"])
    assert actions("", args) == ["/elsewhere", "/fibonacci"]
    assert action_types("", args) == [TYPE]
    args.action_name = "/nosuch"
    assert TYPE in action_types("", args)
