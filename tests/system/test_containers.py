"""Programs in containers that share a bus, made of namespaces; and the files that docs/containers.md shows.

Needs root, for the namespaces.
"""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import yaml

from bus_cli.main import COMMANDS
from conftest import WAIT_S
from neighbours import wait_until
from pages import ROOT, blocks

PAGE = (ROOT / "docs" / "containers.md").read_text()

NAMESPACES = ("--mount", "--pid", "--ipc", "--net", "--uts", "--fork", "--kill-child", "--mount-proc")
ROOTLESS = ("--user", "--map-root-user")
SET_UP = """
mount -t tmpfs -o size=64k none /dev/shm && mount --bind "$1" /mnt && mount -o remount,ro,bind / || exit 77
shift
exec "$@"
"""
PROGRAM = """
import os
import sys

import bus
from bus.msg.std_msgs import String



async def talk(node):
    publisher = await node.create_publisher(String, "topic", 10)
    node.create_timer(0.02, lambda: publisher.publish(String(data=f"from {os.getpid()}")))
    await node.spin()


async def listen(node):
    subscription = await node.create_subscription(String, "topic", 10)
    message, info = await subscription.receive()
    print(message.data, os.getpid(), *[match.route for match in subscription.matches])


async def main():
    async with bus.Node(sys.argv[1], arguments=[]) as node:
        print("ready", flush=True)
        await globals()[sys.argv[1]](node)


bus.run(main())
"""

Box = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Box]:
    """Starts Python in a container, with a read-only root and nothing in common but `tmp_path`, at /mnt."""
    environ = {**os.environ, "BUSD_SOCKET": "/mnt/0.sock", "BUSD_AUTOSTART": "0"}

    def start(*arguments: str, options: tuple[str, ...] = ()) -> "subprocess.Popen[str]":
        words = ["unshare", *NAMESPACES, *options, "sh", "-c", SET_UP, "-", str(tmp_path), sys.executable]
        program = subprocess.Popen([*words, *arguments], stdout=subprocess.PIPE, text=True, env=environ)
        stack.callback(program.wait, WAIT_S)
        stack.callback(program.kill)  # and the kernel the process in the namespace
        assert program.stdout is not None
        stack.callback(program.stdout.close)
        return program

    with ExitStack() as stack:
        tried = start("-c", "")
        if tried.wait(WAIT_S):
            pytest.skip("namespaces need root and unshare")
        yield start


def is_listening(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        return probe.connect_ex(str(path)) == 0


def end(program: "subprocess.Popen[str]") -> int:
    """Send SIGTERM to the PID 1 of its namespace, as docker stop does; returns the exit status."""
    (child,) = Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text().split()
    os.kill(int(child), signal.SIGTERM)
    return program.wait(WAIT_S)


@pytest.mark.parametrize("route", ["shm"], indirect=True)
def test_containers_share_memory(route: str, box: Box, tmp_path: Path) -> None:
    busd = box("-m", "busd")
    wait_until(lambda: is_listening(tmp_path / "0.sock"))
    talker = box("-c", PROGRAM, "talk")
    assert talker.stdout is not None
    assert talker.stdout.readline() == "ready\n"
    listeners = [box("-c", PROGRAM, "listen"), box("-c", PROGRAM, "listen", options=ROOTLESS)]
    for listener in listeners:
        heard, _ = listener.communicate(timeout=WAIT_S)
        assert heard == "ready\nfrom 1 1 shm\n"
    assert end(talker) == 1
    assert end(busd) == 0


def test_the_files_of_the_page() -> None:
    (image,) = blocks("dockerfile", PAGE)
    lines = image.splitlines()
    assert len(lines) < 11
    variables = dict(line.removeprefix("ENV ").split("=") for line in lines if line.startswith("ENV "))
    folder = Path(variables["BUSD_SOCKET"]).parent
    assert f"-m 0700 {folder}" in image
    (compose,) = blocks("yaml", PAGE)
    services = yaml.safe_load(compose)["services"]
    assert lines[-1].split('"')[1:4:2] == services["talker"]["command"].split()
    for name, service in services.items():
        assert service["volumes"] == [f"bus:{folder}"]
        program, *arguments = service["command"].split()
        assert program == name if not arguments else (ROOT / "examples" / arguments[0]).is_file()
    _, tool, command, verb = services["busd"]["healthcheck"]["test"]
    assert tool == "bus"
    assert verb in COMMANDS[command][1]
