"""Programs with a busd that was installed without the native core."""

import os
import subprocess
import sys

import pytest

from conftest import WAIT_S, Daemon

TWO_NODES = """
import sys
sys.modules["bus.shm._core"] = None  # as if it were not there
import bus
from bus.msg.std_msgs import String

async def main():
    async with bus.Node("{name}") as node, bus.Node("{name}_2") as other:
        subscription = await node.create_subscription(String, "t")
        publisher = await other.create_publisher(String, "t")
        publisher.publish(String(data="hi"))
        message, _ = await subscription.receive()
        print(message.data, *(match.route for match in publisher.matches))

bus.run(main())
"""


@pytest.mark.parametrize(
    ("name", "variables", "lines"),
    [
        ("program", {}, 1),
        ("program", {"BUS_ROUTE": "socket"}, 0),
        ("program", {"BUS_NATIVE": "no"}, 0),
        ("_tool", {}, 0),
    ],
)
def test_the_first_node_says_what_is_missing(
    daemon: Daemon, name: str, variables: dict[str, str], lines: int
) -> None:
    """Except if the user asked for that. Tools have hidden nodes and do not repeat it at each call."""
    environ = {key: value for key, value in os.environ.items() if key not in ("BUS_ROUTE", "BUS_NATIVE")}
    done = subprocess.run(
        [sys.executable, "-c", TWO_NODES.format(name=name)],
        env={**environ, **variables},
        capture_output=True,
        text=True,
        check=True,
        timeout=WAIT_S,
    )
    assert done.stdout == "hi socket\n"
    said = [line.split("] ", 2)[2] for line in done.stderr.splitlines()]
    expected = "[bus]: messages go by socket, not by shared memory: the native core was not built ("
    assert [line.startswith(expected) and "BUS_NATIVE=yes" in line for line in said] == [True] * lines
