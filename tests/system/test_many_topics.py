"""A program with more topics than its limit of open files can still open its own files."""

import json
import subprocess
import sys

import pytest

from conftest import WAIT_S, Daemon

PROGRAM = """
import asyncio, json, os, resource, select, sys
import bus
from bus.msg.std_msgs import Int32

soft, hard, topics, own = map(int, sys.argv[1:])
if not hard:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))

async def main():
    async with bus.Node("busy", arguments=[]) as node:
        publishers = [await node.create_publisher(Int32, f"t{number}", 10) for number in range(topics)]
        ends = [await node.create_subscription(Int32, f"t{number}", 10) for number in (0, topics - 1)]
        files = [os.open(os.devnull, os.O_RDONLY) for _ in range(own)]
        assert select.select([files[-1]], [], [], 0)[0] == [files[-1]]
        for _ in range(100):  # of which rings grow
            for publisher in (publishers[0], publishers[-1]):
                publisher.publish(Int32(data=7))
            for end in ends:
                assert (await end.receive())[0].data == 7
        routes = [match.route for match in (await node.graph()).matches]
        print(json.dumps([sorted(routes), resource.getrlimit(resource.RLIMIT_NOFILE)[0], max(files)]))

bus.run(main())
"""


def run(*numbers: int) -> tuple[list[str], int, int, str]:
    """The routes of the first and last topic, the final soft limit, the program's highest number, its log."""
    arguments = [sys.executable, "-c", PROGRAM, *map(str, numbers)]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert not done.returncode, done.stderr
    routes, soft, highest = json.loads(done.stdout)
    return routes, soft, highest, done.stderr


@pytest.mark.parametrize("route", ["shm"], indirect=True)
class TestOpenFiles:
    def test_most_of_the_soft_limit_is_the_programs(self, route: str, daemon: Daemon) -> None:
        routes, soft, highest, log = run(1024, 0, 1100, 980)
        assert routes == ["shm", "shm"]
        assert soft == 1024
        assert highest < 1024  # as select() needs it
        assert log == ""

    def test_of_the_hard_limit_some_are_left(self, route: str, daemon: Daemon) -> None:
        """Further topics use the socket route, and work."""
        routes, _, _, log = run(400, 400, 500, 128)
        assert routes == ["shm", "socket"]
        assert log.count("\n") == 1
        assert "of 400 descriptors are in use, the rest is left to the program" in log
