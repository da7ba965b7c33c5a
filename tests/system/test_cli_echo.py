"""`bus topic echo`, against the texts of the real `ros2`."""

import os
import pty
import re
import signal
from contextlib import AbstractContextManager, ExitStack

import msgspec
import pytest

from bus.graph import Graph
from cli import (
    BUS,
    TALKER,
    Result,
    Running,
    begin,
    bus,
    messages_on_topic,
    script,
    start,
    wait_for_graph,
    without_hint,
)
from conftest import WAIT_S

# Publishes the message of each line of its input, a Python expression.
TELLER = """
import asyncio, enum, sys, bus, msgspec
from bus import QoSProfile
from bus.msg.std_msgs import *
from bus.msg.sensor_msgs import *
from bus.msg.geometry_msgs import *
class Gear(enum.Enum):
    LOW = "low"
    HIGH = "high"
class Wheel(msgspec.Struct):
    index: int
    speed: float = 0.5
Wide = msgspec.defstruct("Wide", [(f"f{at}", int, 0) for at in range(1000)], omit_defaults=True)
class Bomb(msgspec.Struct):
    items: list[Wide] = []
class Car(msgspec.Struct):
    name: str
    gear: Gear = Gear.LOW
    wheels: list[Wheel] = []
    plate: bytes = b"AB"
    owner: str | None = None
async def main():
    loop = asyncio.get_running_loop()
    async with bus.Node("teller") as node:
        publisher = await node.create_publisher(eval(sys.argv[1]), "/topic", eval(sys.argv[2]))
        print("ready", flush=True)
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            await publisher.send(eval(line))
            await publisher.flush()
bus.run(main())
"""


def tell(message_type: str = "String", qos: str = "10") -> AbstractContextManager[Running]:
    return script(TELLER, message_type, qos)


def test_yaml(daemon: object) -> None:
    with tell() as teller, start("topic", "echo", "/topic") as echo:
        matched()
        teller.write("String(data='Hello World: 1')\nString(data='Hello')\nString()\n")
        assert echo.lines(6) == "data: 'Hello World: 1'\n---\ndata: Hello\n---\ndata: ''\n---\n"
        assert without_hint(echo.end(signal.SIGINT)) == Result("", "", -signal.SIGINT)


def matched(count: int = 1) -> None:
    """Wait until the topic's only publisher is matched with `count` subscriptions."""

    def has_matches(graph: Graph) -> bool:
        (publisher,) = graph.publishers_of("/topic")
        return sum(one.publisher == publisher.id for one in graph.matches) == count

    wait_for_graph(has_matches)


def echo_all(message_type: str, message: str, outputs: dict[str, str]) -> None:
    """Runs an echo for each of the options side by side, publishes one message, compares the outputs."""
    with tell(message_type) as teller, ExitStack() as stack:
        running = {
            options: stack.enter_context(start("topic", "echo", "/topic", "--once", *options.split()))
            for options in outputs
        }
        matched(len(running))
        teller.write(f"{message}\n")
        results = {options: without_hint(echo.end()) for options, echo in running.items()}
        assert results == {options: Result(out, "", 0) for options, out in outputs.items()}


def test_options_for_a_text(daemon: object) -> None:
    yaml = "data: 'Hello World: 1'\n---\n"
    echo_all(
        "String",
        "String(data='Hello World: 1')",
        {
            "": yaml,
            "std_msgs/msg/String": yaml,
            "std_msgs/String": yaml,
            "--field data": "Hello World: 1\n---\n",
            "--field data -l 5": "Hello...\n---\n",
            "--csv": "Hello World: 1\n",
            "--csv -l 1": "H...\n",
            "--csv --field data": "Hello World: 1\n",
            "--raw": "b'\\x91\\xaeHello World: 1'\n---\n",
            "--json": '{"data":"Hello World: 1"}\n',
            "--json -l 3": '{"data":"Hel..."}\n',
            "--json --field data": '{"data":"Hello World: 1"}\n',
            "--raw --json": '{"raw":"91ae48656c6c6f20576f726c643a2031"}\n',
            "--no-str": "data: '<string length: <14>>'\n---\n",
            "-l 5": "data: Hello...\n---\n",
            "-c --no-lost-messages": yaml,
            "--qos-profile default": yaml,
            "--qos-depth 1 --qos-history keep_last": yaml,
            "--qos-reliability best_effort --filter m.data!=''": yaml,
        },
    )


def test_options_for_a_long_text(daemon: object) -> None:
    echo_all(
        "String",
        "String(data='x' * 200)",
        {
            "": f"data: {'x' * 128}...\n---\n",
            "-f": f"data: {'x' * 200}\n---\n",
            "-l 0": "data: '...'\n---\n",
            "--field data": f"{'x' * 200}\n---\n",
            "--json": f'{{"data":"{"x" * 200}"}}\n',
        },
    )


def test_sequences(daemon: object) -> None:
    echo_all(
        "JointState",
        "JointState(name=['a', 'b'], position=[1, 2.5])",
        {
            "": "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
            "name:\n- a\n- b\nposition:\n- 1.0\n- 2.5\nvelocity: []\neffort: []\n---\n",
            "--flow-style --field name --field position": "[a, b]\n[1.0, 2.5]\n---\n",
            "--field name[1]": "b\n---\n",
            "--csv --field name --field position": "a,b,1.0,2.5\n",
            "--no-arr --field name": "<sequence type: string, length: 2>\n---\n",
            "--field header.stamp": "sec: 0\nnanosec: 0\n---\n",
            "--field header.stamp.sec": "0\n---\n",
        },
    )


@pytest.mark.parametrize(
    ("message", "outputs"),
    [
        ("Image(data=bytes(300))", {"--field data": "- 0\n" * 128 + "- '...'\n---\n"}),
        (
            "PoseWithCovariance()",
            {"--no-arr --csv": "0.0,0.0,0.0,0.0,0.0,0.0,1.0,<array type: double[36]>\n"},
        ),
        ("Byte(data=b'A')", {"": "data: A\n---\n", "--json": '{"data":65}\n'}),
        ("Float64(data=float('nan'))", {"": "data: .nan\n---\n", "--json": '{"data":null}\n'}),
        ("Empty()", {"": "{}\n---\n", "--json": "{}\n"}),
        (
            "Car('x', Gear.HIGH, [Wheel(1)])",
            {
                "": "name: x\ngear: high\nwheels:\n- index: 1\n  speed: 0.5\n"
                "plate:\n- 65\n- 66\nowner: null\n---\n",
                "local/msg/Car --field wheels[0].speed": "0.5\n---\n",
                "--json --field gear --field plate[1]": '{"gear":"high","plate[1]":66}\n',
            },
        ),
    ],
)
def test_types_also_those_that_the_tool_cannot_import(
    daemon: object, message: str, outputs: dict[str, str]
) -> None:
    echo_all(message.partition("(")[0], message, outputs)


def test_message_info(daemon: object) -> None:
    with tell() as teller, start("topic", "echo", "-i", "/topic") as echo:
        matched()
        teller.write("String(data='a')\nString(data='b')\n")
        text = echo.lines(14)
    info = r"publication_sequence_number: {0}\nreceived_timestamp: \d{{19}}\nreception_sequence_number: {0}\n"
    pattern = "".join(
        info.format(number) + rf"source_timestamp: \d{{19}}\n---\ndata: {data}\n---\n"
        for number, data in ((1, "a"), (2, "b"))
    )
    assert re.fullmatch(pattern, text)


def test_message_info_in_csv_and_json(daemon: object) -> None:
    with tell() as teller, start("topic", "echo", "-i", "--csv", "/topic") as echo:
        matched()
        teller.write("String(data='a')\n")
        source_ns, received_ns, *rest = echo.line().split(",")
        assert (rest, int(source_ns) <= int(received_ns)) == (["1", "1", "a"], True)
    with tell() as teller, start("topic", "echo", "-i", "--json", "/topic") as echo:
        matched()
        teller.write("String(data='a')\n")
        record = msgspec.json.decode(echo.line())
    assert record["message"] == {"data": "a"}
    assert record["info"]["publication_sequence_number"] == 1


def test_filter(daemon: object) -> None:
    with tell("Int32") as teller, start("topic", "echo", "/topic", "--filter", "m.data % 2 == 0") as echo:
        matched()
        teller.write("".join(f"Int32(data={number})\n" for number in range(4)))
        assert echo.lines(4) == "data: 0\n---\ndata: 2\n---\n"


def test_a_filter_that_does_not_fit_ends_it(daemon: object) -> None:
    with tell() as teller, start("topic", "echo", "/topic", "--filter", "m.dat == 1") as echo:
        matched()
        teller.write("String()\n")
        assert without_hint(echo.end()) == Result(
            "", "--filter: 'String' object has no attribute 'dat' (in m.dat == 1)\n", 1
        )


def test_raw_goes_with_no_option_for_values() -> None:
    for option in (("--field", "data"), ("--filter", "m.data"), ("--csv",)):
        result = bus("topic", "echo", "/topic", "--raw", *option)
        assert (result.code, result.out) == (1, "")
        assert result.err == "--raw prints encoded messages: leave out --field, --filter and --csv\n"


def test_a_field_that_is_not_there_ends_it_at_once(daemon: object) -> None:
    with tell():
        assert bus("topic", "echo", "/topic", "--field", "x") == Result(
            "", "Invalid field 'x': 'String' object has no attribute 'x'\n", 1
        )


def test_few_bytes_that_are_many_values_are_refused(daemon: object) -> None:
    """Each of these lists has one byte for each item, and each item decodes to a thousand values."""
    with tell("Bomb") as teller, start("topic", "echo", "/topic") as echo:
        matched()
        teller.write("Bomb([Wide()] * 3000)\nBomb([Wide()] * 128)\n")
        ended = echo.end()
    assert (ended.code, ended.out.count("undecodable: 1")) == (1, 1)
    assert "more than 1,000,000 values are left out in it, which would be filled in" in ended.err
    assert "a message on '/topic' has more than 100,000 values to show, even with arrays" in ended.err
    with tell("Bomb") as teller, start("topic", "echo", "/topic", "--no-arr") as echo:
        matched()
        teller.write("Bomb([Wide()] * 128)\n")
        assert echo.lines(2) == "items: '<sequence type: local/msg/Wide, length: 128>'\n---\n"


def test_an_unknown_topic(daemon: object) -> None:
    assert bus("topic", "echo", "/nosuch") == Result(
        "",
        "WARNING: topic [/nosuch] does not appear to be published yet\n"
        "Could not determine the type for the passed topic\n",
        1,
    )


def test_an_unknown_type(daemon: object) -> None:
    hint = "; did you mean 'std_msgs/msg/String'?"
    names = {"std_msgs/msg/Strin": hint, "String": hint, "my_msgs/msg/Own": "", "a/b/c/d": ""}
    for name, near in names.items():
        error = f"The passed message type is invalid{near}\n"
        assert bus("topic", "echo", "/x", name) == Result("", error, 1)


def test_a_topic_with_two_types(daemon: object) -> None:
    with tell(), tell("Int32"):
        result = bus("topic", "echo", "/topic")
    assert result.code == 1
    assert re.fullmatch(
        r"Cannot echo topic '/topic', as it contains more than one type: "
        r"\[std_msgs/msg/(String, std_msgs/msg/Int32|Int32, std_msgs/msg/String)\]\n",
        result.err,
    )


def test_it_says_that_nobody_publishes(daemon: object) -> None:
    with start("topic", "echo", "/nosuch", "std_msgs/msg/String") as echo:
        assert echo.error_line() == "no node publishes on '/nosuch' (waiting)"
        assert echo.end(signal.SIGINT) == Result("", "", -signal.SIGINT)


def test_it_finds_the_topic_that_was_meant(daemon: object) -> None:
    with tell(), start("topic", "echo", "/topci", "std_msgs/msg/String") as echo:
        assert echo.error_line() == "no node publishes on '/topci'; did you mean '/topic'? (waiting)"


def test_it_says_that_the_publisher_is_silent_and_then_gone(daemon: object) -> None:
    with start("topic", "echo", "/topic", "std_msgs/msg/String") as echo:
        with tell():
            assert echo.error_line_with("no message yet") == (
                "no message yet on '/topic'; /teller publishes it, but sent nothing"
            )
        assert echo.error_line_with("no node") == "no node publishes on '/topic' (waiting)"


def test_it_says_that_nothing_passes_the_filter(daemon: object) -> None:
    with script(TALKER, "0.1"), start("topic", "echo", "/topic", "--filter", "m.data == ''") as echo:
        assert echo.error_line_with("messages come") == (
            "messages come on '/topic', but none has passed the filter yet"
        )


def test_it_names_the_node_whose_qos_does_not_match(daemon: object) -> None:
    with tell(), start("topic", "echo", "/topic", "--qos-durability", "transient_local") as echo:
        line = echo.error_line()
    assert (
        "New publisher discovered on topic '/topic', offering incompatible QoS. "
        "No messages will be received from it. Last incompatible policy: DURABILITY" in line
    )
    assert "/teller" in line
    assert "Volatile publisher and transient local subscription" in line


def test_it_names_the_node_whose_type_does_not_match(daemon: object) -> None:
    with tell(), start("topic", "echo", "/topic", "std_msgs/msg/Int32") as echo:
        line = echo.error_line()
    assert "Incompatible type on topic '/topic', no messages will be received from it." in line
    assert "/teller" in line
    assert "std_msgs/msg/String" in line


def test_late_joiners_of_a_lasting_publisher(daemon: object) -> None:
    with tell(qos="QoSProfile(depth=3, durability='transient_local')") as teller:
        teller.write("String(data='old')\n")
        with start("topic", "echo", "/topic", "--once") as echo:
            assert without_hint(echo.end()) == Result("data: old\n---\n", "", 0)


def test_publishers_that_differ_in_reliability(daemon: object) -> None:
    with tell(), tell(qos="'sensor_data'"), start("topic", "echo", "/topic") as echo:
        assert echo.error_line() == (
            "Some, but not all, publishers are offering QoSReliabilityPolicy.RELIABLE. Falling back to "
            "QoSReliabilityPolicy.BEST_EFFORT as it will connect to all publishers"
        )


@pytest.mark.parametrize(("option", "stream"), [("--no-str", "out"), ("--json", "err")])
def test_lost_messages_are_told_with_the_reason(daemon: object, option: str, stream: str) -> None:
    big = "String(data='x' * 200_000)"
    with tell() as teller, start("topic", "echo", "/topic", option, "--qos-depth", "1") as echo:
        matched()
        echo.process.send_signal(signal.SIGSTOP)
        teller.write(f"{big}\n" * 50)
        wait_for_graph(lambda graph: messages_on_topic(graph) == 50)
        echo.process.send_signal(signal.SIGCONT)
        next_line, find = (
            (echo.line, echo.line_with) if stream == "out" else (echo.error_line, echo.error_line_with)
        )
        assert find("lost") == "A message was lost!!!"
        assert re.fullmatch(r"\ttotal count change:\d+", next_line())
        assert re.fullmatch(r"\ttotal count: \d+ \(replaced: \d+\)---", next_line())


def test_no_lost_messages(daemon: object) -> None:
    with tell() as teller, start("topic", "echo", "/topic", "--no-lost-messages", "--csv", "-l", "1") as echo:
        matched()
        echo.process.send_signal(signal.SIGSTOP)
        teller.write("String(data='x' * 200_000)\n" * 50 + "String(data='end')\n")
        wait_for_graph(lambda graph: messages_on_topic(graph) == 51)
        echo.process.send_signal(signal.SIGCONT)
        lines = ["x..."]
        while lines[-1] != "e...":
            lines.append(echo.line())
        assert set(lines) == {"x...", "e..."}
        assert len(lines) < 51
        assert without_hint(echo.end(signal.SIGTERM)) == Result("", "", -signal.SIGTERM)


def test_timeout(daemon: object) -> None:
    with tell():
        assert bus("topic", "echo", "/topic", "--timeout", "0.2") == Result("", "", 0)
        assert bus("topic", "echo", "/topic", "--timeout", "0.2", "--once") == Result(
            "", "no message on '/topic' within 0.2 s\n", 1
        )


def test_it_clears_the_screen_of_a_terminal(daemon: object) -> None:
    ours, theirs = pty.openpty()
    with tell() as teller:
        process = begin((*BUS[1:], "topic", "echo", "/topic", "-c", "--once"), (theirs, theirs, theirs))
        matched()
        teller.write("String(data='x')\n")
        assert process.wait(WAIT_S) == 0
    expected, shown = b"\x1b[2J\x1b[Hdata: x\r\n---\r\n", b""
    while len(shown) < len(expected):  # a terminal may deliver it in pieces
        shown += os.read(ours, 100)
    assert shown == expected
    os.close(ours)
    os.close(theirs)


def test_its_node_may_have_a_name(daemon: object) -> None:
    with tell(), start("topic", "echo", "/topic", "-n", "watcher"):
        matched()
        assert bus("node", "list").out == "/teller\n/watcher\n"
