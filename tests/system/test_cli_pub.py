"""`bus topic pub`, against the texts of the real `ros2`."""

import re
import signal
import time

import msgspec

from cli import LISTENER, Result, Running, bus, script, start, without_hint

STRING = "std_msgs/msg/String"

# Prints each message that arrives as JSON, in order of arrival.
HEARER = """
import asyncio, sys, msgspec, bus
from bus.msg.std_msgs import *
from bus.msg.geometry_msgs import *
class Car(msgspec.Struct):
    name: str
    wheels: list[int] = []
async def main():
    async with bus.Node("hearer") as node:
        def hear(message):
            print(msgspec.json.encode(msgspec.structs.asdict(message)).decode(), flush=True)
        await node.create_subscription(eval(sys.argv[1]), "/topic", 100, hear)
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""


def test_once(daemon: object) -> None:
    with script(HEARER, "String") as hearer:
        assert bus("topic", "pub", "--once", "/topic", STRING, "data: hi") == Result(
            "publisher: beginning loop\npublishing #1: std_msgs.msg.String(data='hi')\n\n", "", 0
        )
        assert hearer.line() == '{"data":"hi"}'


def test_for_ever(daemon: object) -> None:
    with start("topic", "pub", "/topic2", STRING, "data: hi") as running:
        assert running.lines(7) == (
            "publisher: beginning loop\n"
            "publishing #1: std_msgs.msg.String(data='hi')\n\n"
            "publishing #2: std_msgs.msg.String(data='hi')\n\n"
            "publishing #3: std_msgs.msg.String(data='hi')\n\n"
        )
        rest = running.end(signal.SIGINT)
    assert (rest.err, rest.code) == ("", -signal.SIGINT)
    assert re.fullmatch(r"(publishing #\d+: std_msgs\.msg\.String\(data='hi'\)\n\n)*", rest.out)


def test_every_nth_is_printed(daemon: object) -> None:
    with start("topic", "pub", "-r", "100", "-p", "5", "/topic2", STRING, "data: hi") as running:
        assert running.lines(5) == (
            "publisher: beginning loop\n"
            "publishing #5: std_msgs.msg.String(data='hi')\n\n"
            "publishing #10: std_msgs.msg.String(data='hi')\n\n"
        )


def test_nothing_is_printed(daemon: object) -> None:
    words = ("topic", "pub", "-p", "0", "-t", "3", "-r", "100", "-w", "0", "/topic2", STRING)
    assert bus(*words) == Result("publisher: beginning loop\n", "", 0)


def test_times(daemon: object) -> None:
    with script(HEARER, "String") as hearer:
        result = bus("topic", "pub", "-t", "3", "-r", "50", "/topic", STRING, "data: hi")
        assert result.code == 0
        assert re.findall(r"publishing #(\d+)", result.out) == ["1", "2", "3"]
        assert hearer.lines(3) == '{"data":"hi"}\n' * 3


def test_it_waits_for_a_subscription(daemon: object) -> None:
    with start("topic", "pub", "--once", "/topic", STRING, "data: hi") as running:
        assert running.lines(2) == "Waiting for at least 1 matching subscription(s)...\n" * 2
        with Running(("-c", HEARER, "String")) as hearer:
            assert running.line_with("publisher") == "publisher: beginning loop"
            assert hearer.line_with("data") == '{"data":"hi"}'
            assert running.end().code == 0


def test_it_waits_for_as_many_as_asked(daemon: object) -> None:
    with script(LISTENER), start("topic", "pub", "-w", "2", "/topic", STRING) as running:
        assert running.line() == "Waiting for at least 2 matching subscription(s)..."
        with script(LISTENER):
            assert running.line_with("publisher") == "publisher: beginning loop"


def test_it_gives_up(daemon: object) -> None:
    words = ("topic", "pub", "--once", "/topic", STRING, "--max-wait-time-secs", "0.2")
    assert bus(*words) == Result(
        "Waiting for at least 1 matching subscription(s)...\n",
        "Timed out waiting for subscribers: Expected 1 subscribers but only got 0 subscribers\n",
        1,
    )


def test_mistakes(daemon: object) -> None:
    for words, text in (
        (
            (STRING, "dat: hi"),
            "Failed to populate field: 'String' object has no attribute 'dat'; did you mean 'data'?",
        ),
        ((STRING, "hi"), "The passed value needs to be a dictionary in YAML format"),
        (
            ("std_msgs/msg/Strin", "data: hi"),
            "The passed message type is invalid; did you mean 'std_msgs/msg/String'?",
        ),
        (("nosuch_msgs/msg/Nonsense", "data: hi"), "The passed message type is invalid"),
        (
            ("String", "data: hi"),
            "The passed message type is invalid; did you mean 'std_msgs/msg/String'?",
        ),
        (
            ("std_msgs/msg/Int8", "data: 200"),
            "Failed to populate field: std_msgs/msg/Int8: Expected `int` <= 127 - at `$.data`",
        ),
        ((STRING, "data: hi", "--qos-depth", "0"), "QoS depth must be from 1 to 2147483647, not 0"),
    ):
        assert bus("topic", "pub", "--once", "/topic", *words) == Result("", f"{text}\n", 1)


def test_a_type_that_is_only_on_the_bus(daemon: object) -> None:
    with script(HEARER, "Car") as hearer:
        result = bus("topic", "pub", "--once", "/topic", "local/msg/Car", "{name: x, wheels: [1, 2]}")
        assert result.out == (
            "publisher: beginning loop\npublishing #1: local.msg.Car(name='x', wheels=[1, 2])\n\n"
        )
        assert hearer.line() == '{"name":"x","wheels":[1,2]}'
        # On any topic, not only on the topics that use the type.
        assert bus("topic", "pub", "--once", "-w", "0", "/other", "local/Car", "name: y").code == 0


def test_stamps(daemon: object) -> None:
    with script(HEARER, "Header") as hearer:
        before_ns = time.time_ns()
        result = bus("topic", "pub", "-t", "2", "-r", "100", "/topic", "std_msgs/Header", "stamp: now")
        assert result.code == 0, result.err
        stamps = [msgspec.json.decode(hearer.line())["stamp"] for _ in range(2)]
    first_ns, second_ns = (sec * 10**9 + nanosec for sec, nanosec in stamps)
    assert before_ns <= first_ns < second_ns <= time.time_ns()


def test_auto_fills_a_header(daemon: object) -> None:
    with script(HEARER, "PointStamped") as hearer:
        assert bus("topic", "pub", "--once", "/topic", "geometry_msgs/PointStamped", "header: auto").code == 0
        ((sec, _), frame_id) = msgspec.json.decode(hearer.line())["header"]
    assert (sec > 0, frame_id) == (True, "")


def test_documents_from_the_standard_input_leave_when_they_come(daemon: object) -> None:
    with (
        script(HEARER, "String") as hearer,
        start("topic", "pub", "-w", "1", "/topic", STRING, "--stdin") as running,
    ):
        running.write("data: a\n---\n")
        assert hearer.line() == '{"data":"a"}'
        running.write('{"data":"b"}\n')
        assert hearer.line() == '{"data":"b"}'
        running.write("data: c\n")
        assert running.end().code == 0
        assert hearer.line() == '{"data":"c"}'


def test_documents_at_a_rate_and_up_to_a_number(daemon: object) -> None:
    documents = "".join(f"data: '{number}'\n---\n" for number in range(5))
    with script(HEARER, "String") as hearer:
        result = bus("topic", "pub", "-r", "100", "-t", "3", "/topic", STRING, "--stdin", stdin=documents)
        assert result.code == 0
        assert hearer.lines(3) == '{"data":"0"}\n{"data":"1"}\n{"data":"2"}\n'


def test_a_wrong_document_ends_it(daemon: object) -> None:
    words = ("topic", "pub", "/topic", STRING, "--stdin")
    for document, text in (
        (
            "dat: 1\n",
            "Failed to populate field: 'String' object has no attribute 'dat'; did you mean 'data'?\n",
        ),
        ("hi\n", "The passed value needs to be a dictionary in YAML format\n"),
    ):
        assert bus(*words, stdin=document) == Result("publisher: beginning loop\n", text, 1)


def test_a_signal_while_it_reads(daemon: object) -> None:
    with start("topic", "pub", "/topic", STRING, "--stdin") as running:
        running.line()
        assert running.end(signal.SIGINT) == Result("", "", -signal.SIGINT)


def test_echo_can_be_piped_into_pub(daemon: object) -> None:
    with (
        script(HEARER, "String") as hearer,
        start("topic", "echo", "/source", STRING) as echo,
        start("topic", "pub", "/topic", STRING, "--stdin") as copy,
    ):
        copy.line()
        assert bus("topic", "pub", "--once", "/source", STRING, "data: 'a: b'").code == 0
        copy.write(echo.lines(2))
        assert hearer.line() == '{"data":"a: b"}'


def test_json(daemon: object) -> None:
    words = ("topic", "pub", "-t", "2", "-w", "0", "-r", "100", "/topic", STRING, "data: hi", "--json")
    assert bus(*words).out == '{"count":1,"message":{"data":"hi"}}\n{"count":2,"message":{"data":"hi"}}\n'


def test_name_and_qos(daemon: object) -> None:
    words = ("topic", "pub", "/topic", STRING, "-n", "talker", "--qos-durability", "transient_local")
    with start(*words, "--qos-depth", "3", "--qos-reliability", "best_effort") as running:
        running.line()
        assert bus("node", "list").out == "/talker\n"
        text = bus("topic", "info", "-v", "/topic").out
    assert (
        "  Reliability: BEST_EFFORT\n  History (Depth): KEEP_LAST (3)\n  Durability: TRANSIENT_LOCAL\n"
        in text
    )


def test_it_stays_for_late_joiners(daemon: object) -> None:
    words = ("topic", "pub", "--once", "-w", "0", "/topic", STRING, "data: old", "--keep-alive", "1000")
    with start(*words, "--qos-durability", "transient_local") as running:
        running.line_with("publishing #1")
        heard = bus("topic", "echo", "--once", "/topic")
        assert without_hint(heard) == Result("data: old\n---\n", "", 0)
