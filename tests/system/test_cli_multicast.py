"""`bus multicast` and `bus doctor hello`: datagrams between programs of one machine."""

import signal
import socket

import msgspec
import pytest

from bus_cli.multicast.udp import GROUP, PORT
from cli import Result, bus, script, start

SENDING = "Sending one UDP multicast datagram...\n"
ECHO = """
import asyncio, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("elsewhere") as node:
        publisher = await node.create_publisher(String, "hello", 10)
        print("ready", flush=True)
        while True:
            await publisher.wait_for_subscriptions(1)
            publisher.publish(String(data="hello, it's me elsewhere"))
            await asyncio.sleep(0.05)
bus.run(main())
"""


@pytest.fixture
def port() -> int:
    """A port of UDP that no program uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("", 0))
        found: int = free.getsockname()[1]
    return found


@pytest.fixture(autouse=True)
def can_multicast(port: int) -> None:
    sent = bus("multicast", "send", "--port", str(port))
    if sent.code and "Network is unreachable" in sent.err:
        pytest.skip("this machine has no route for multicast")


def test_send_and_receive(port: int) -> None:
    words = ("--port", str(port), "--group", "225.0.0.7")
    with start("multicast", "receive", *words) as receive:
        assert receive.line() == "Waiting for UDP multicast datagram..."
        assert bus("multicast", "send", "--ttl", "1", *words) == Result(SENDING, "", 0)
        line = receive.line()
        assert line.startswith("Received from ")
        assert line.endswith(": 'Hello World!'")
        assert receive.end().code == 0


def test_json_and_bytes_of_any_kind(port: int) -> None:
    with start("multicast", "receive", "--json", "--port", str(port)) as receive:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while receive.process.poll() is None:
                out.sendto(b"\xff\x1b", (GROUP, port))
        record = msgspec.json.decode(receive.line())
    assert record["data"] == "\\xff\x1b"
    sent = bus("multicast", "send", "--json", "--port", str(port))
    assert sent.out == f'{{"group":"{GROUP}","port":{port},"data":"Hello World!"}}\n'


def test_what_can_not_be(port: int) -> None:
    for words, text in {
        "receive --group nonsense": "'nonsense' is not a multicast group; groups are 224.0.0.0 to ",
        "receive --group 10.0.0.1": "'10.0.0.1' is not a multicast group; groups are 224.0.0.0 to ",
        "send --group 300.1.1.1": "'300.1.1.1' is not a multicast group; groups are 224.0.0.0 to ",
        "send --group 127.0.0.1": "'127.0.0.1' is not a multicast group; groups are 224.0.0.0 to ",
    }.items():
        result = bus("multicast", *words.split())
        assert (result.err.startswith(text), result.out, result.code) == (True, "", 1), result
    for words in ("send --port 0", "send --port 65536", "send --ttl 256", "receive --port x"):
        assert bus("multicast", *words.split()).code == 2


def test_ended_by_a_signal(port: int) -> None:
    with start("multicast", "receive", "--port", str(port)) as receive:
        receive.line()
        assert receive.end(signal.SIGINT) == Result("", "", -signal.SIGINT)


def test_hello_once(daemon: object) -> None:
    result = bus("doctor", "hello", "--once", "-ep", "0.01")
    lines = result.out.splitlines()
    assert (result.err, result.code) == ("", 0)
    assert lines[0] == "MULTIMACHINE COMMUNICATION SUMMARY"
    assert lines[1] == "Topic: /canyouhearme, Published Msg Count: 1"
    assert lines[2:4] == ["Subscribed from:", f"{'':<15} {'Hostname':<20} Msg Count /1.0s"]
    assert f"Multicast Group/Port: {GROUP}/{PORT}, Sent Msg Count: 1" in lines
    assert lines[-1] == "-" * 60


def test_hello_counts_others(daemon: object) -> None:
    with (
        script(ECHO),
        start("wtf", "hello", "-t", "/hello", "-ep", "0.02", "-pp", "0.2", "--json") as hello,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out,
    ):
        heard: dict[str, object] = {}
        while not (heard.get("subscribed_from") and heard.get("received_from")):
            out.sendto(b"hello, it's me afar", (GROUP, PORT))
            heard = msgspec.json.decode(hello.line())
            assert heard["published"] == heard["sent"]
        assert list(heard["subscribed_from"]) == ["elsewhere"]  # type: ignore[call-overload]
        assert list(heard["received_from"]) == ["afar"]  # type: ignore[call-overload]
        assert hello.end(signal.SIGINT).code == -signal.SIGINT
