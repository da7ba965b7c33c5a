"""A publisher in a different time namespace from its subscription: ages and lifespans are as with one clock.

Needs root, for a time namespace.
"""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import String
from conftest import WAIT_S
from semantics import until

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
def talker(request: pytest.FixtureRequest, daemon: object) -> Iterator["subprocess.Popen[str]"]:
    """Publishes the lines of its stdin. Its clock is off by more than its lifespan, or by half an uptime."""
    uptime_s = float(Path("/proc/uptime").read_text().split()[0])
    offset_s = 86_400 if request.param == "ahead" else -int(uptime_s / 2)
    inside = ("unshare", "--fork", "--kill-child", "--time", "--monotonic", str(offset_s))
    if subprocess.run([*inside, "true"], capture_output=True, check=False).returncode:
        pytest.skip("a time namespace needs root and unshare")
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
