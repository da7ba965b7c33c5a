"""A publisher in a different time namespace from its subscription: ages and lifespans are as with one clock.

Needs root, for a time namespace.
"""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import bus
import c_programs
from bus.msg.std_msgs import String
from conftest import WAIT_S
from programs import on_one_loop, running_command
from semantics import LATCHED, until, until_busd_has_all

TALKER = """
import sys
import bus
from bus.msg.std_msgs import String
from bus.qos import Durability

with bus.connect("talker", arguments=[]) as node:
    qos = bus.QoSProfile(1000, lifespan=3600.0, durability=Durability.TRANSIENT_LOCAL)
    publishers = [node.create_publisher(String, "topic", qos), node.create_publisher(String, "plain", 10)]
    print("ready", flush=True)
    for line in sys.stdin:
        for publisher in publishers:
            publisher.publish(String(data=line.strip()))
"""


@pytest.fixture(params=["ahead", "behind"])
def inside(request: pytest.FixtureRequest) -> tuple[str, ...]:
    """Runs a command whose clock is off by more than its lifespan, or by half an uptime."""
    uptime_s = float(Path("/proc/uptime").read_text().split()[0])
    offset_s = 86_400 if request.param == "ahead" else -int(uptime_s / 2)
    inside = ("unshare", "--fork", "--kill-child", "--time", "--monotonic", str(offset_s))
    if subprocess.run([*inside, "true"], capture_output=True, check=False).returncode:
        pytest.skip("a time namespace needs root and unshare")
    return inside


@pytest.fixture
def talker(inside: tuple[str, ...], daemon: object) -> Iterator["subprocess.Popen[str]"]:
    """Publishes the lines of its stdin."""
    command = [*inside, sys.executable, "-c", TALKER]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdin is not None
        assert process.stdout.readline() == "ready\n"
        yield process
        process.stdin.close()


def test_ages_and_lifespans(route: str, talker: "subprocess.Popen[str]") -> None:
    say = talker.stdin
    assert say is not None
    with bus.connect("listener") as node:
        print("history", file=say, flush=True)
        qos = bus.QoSProfile(1000, durability=bus.Durability.TRANSIENT_LOCAL)
        subscription = node.create_subscription(String, "topic", qos)
        heard = [subscription.receive(WAIT_S)]
        for number in range(100):
            print(number, file=say, flush=True)
        heard += [subscription.receive(WAIT_S) for _ in range(100)]
        assert [message.data for message, _ in heard] == ["history", *map(str, range(100))]
        for _, info in heard:
            assert 0 <= info.received_timestamp - info.source_timestamp < WAIT_S * 1e9
        counted = subscription.statistics()
        assert counted.dropped == {}
        assert counted.age_count and 0 < counted.age_max_ns < WAIT_S * 1e9


async def test_ages_of_a_callback(route: str, talker: "subprocess.Popen[str]") -> None:
    """Messages for a callback do not wait in a queue."""
    heard: list[str] = []
    async with bus.Node("listener") as node:
        subscription = await node.create_subscription(String, "plain", 10, lambda one: heard.append(one.data))
        await subscription.wait_for_publishers()
        for number in range(100):
            print(number, file=talker.stdin, flush=True)
            await until(lambda number=number: str(number) in heard)
        counted = subscription.statistics()
        assert counted.age_count and 0 < counted.age_max_ns < WAIT_S * 1e9


@on_one_loop
async def test_a_late_joiner_of_a_publisher_in_c(
    route: str,
    inside: tuple[str, ...],
    daemon: object,
    tmp_path_factory: pytest.TempPathFactory,
    tmp_path: Path,
) -> None:
    """It gets as many messages of the history as with one clock."""
    command = (
        *inside,
        str(c_programs.build_once(tmp_path_factory) / "peer"),
        "talk",
        "/topic",
        "9",
        "latched",
        "depth=3",
    )
    async with running_command(tmp_path, *command) as program, bus.Node("late") as node:
        await program.line("^published$")
        subscription = await node.create_subscription(String, "/topic", LATCHED)
        assert [(await subscription.receive())[0].data.split()[0] for _ in range(3)] == ["6", "7", "8"]


@on_one_loop
async def test_a_subscription_in_c(
    route: str,
    inside: tuple[str, ...],
    daemon: object,
    tmp_path_factory: pytest.TempPathFactory,
    tmp_path: Path,
) -> None:
    """Messages with a lifespan reach it, and it gets the right history."""
    command = (*inside, str(c_programs.build_once(tmp_path_factory) / "peer"), "listen", "/topic", "latched")
    qos = bus.QoSProfile(3, durability=bus.Durability.TRANSIENT_LOCAL, lifespan=WAIT_S)
    async with bus.Node("early") as node:
        publisher = await node.create_publisher(String, "/topic", qos)
        for number in range(9):
            publisher.publish(String(data=f"{number} "))
        await until_busd_has_all(publisher, node)
        async with running_command(tmp_path, *command) as program:
            await program.line("^8 ")
            assert [line[:2] for line in program.lines if line[0].isdigit()] == ["6 ", "7 ", "8 "]
