"""A busd in another pid namespace than its clients, as in containers that share a socket: all pids are 0.

Needs root, for a pid namespace.
"""

import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.wire import messages as m
from bus.wire.layout import NAMESAKES, PROTOCOL_VERSION
from neighbours import wait_until
from raw_peer import RawPeer

INSIDE = ("unshare", "--pid", "--fork", "--kill-child", "--mount-proc")

TWIN = """
import sys
import bus

with bus.connect("twin", arguments=[]):
    print("ready", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def path(tmp_path: Path) -> Iterator[Path]:
    if subprocess.run([*INSIDE, "true"], capture_output=True, check=False).returncode:
        pytest.skip("a pid namespace needs root and unshare")
    path = tmp_path / "busd.sock"
    with subprocess.Popen([*INSIDE, sys.executable, "-m", "busd", "--socket", str(path)]) as process:
        try:
            wait_until(lambda: is_listening(path))
            yield path
        finally:
            process.kill()  # and the kernel kills the process in the namespace


def is_listening(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        return probe.connect_ex(str(path)) == 0


def connect(path: Path) -> RawPeer:
    peer = RawPeer(path)
    peer.send(m.Hello(version=PROTOCOL_VERSION, program="raw peer", capabilities=(NAMESAKES,)))
    peer.expect(m.Hello)
    return peer


def test_two_processes_with_nodes_of_one_name_are_told(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_SOCKET", str(path))
    with connect(path) as peer:
        node = peer.node("twin")
        command = [sys.executable, "-c", TWIN]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as twin:
            namesake = peer.expect(m.Namesake)
            assert (namesake.node, namesake.pid) == (node, 0)
            _, said = twin.communicate()
        assert "there is another node named /twin, in a process of raw peer," in said
