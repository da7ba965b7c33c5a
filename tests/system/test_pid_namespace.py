"""A busd in another pid namespace than its clients, as in containers that share a socket.

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
from bus_cli.query import Query
from cli import bus
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
def path(tmp_path: Path) -> Path:
    return tmp_path / "busd.sock"


@pytest.fixture(autouse=True)
def process(path: Path) -> Iterator[subprocess.Popen[bytes]]:
    if subprocess.run([*INSIDE, "true"], capture_output=True, check=False).returncode:
        pytest.skip("a pid namespace needs root and unshare")
    with subprocess.Popen([*INSIDE, sys.executable, "-m", "busd", "--socket", str(path)]) as process:
        try:
            wait_until(lambda: is_listening(path))
            yield process
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


def test_tools_outside_know_its_process(path: Path, process: subprocess.Popen[bytes]) -> None:
    """busd itself says 1, which is another process here."""
    with Query(path, may_start=False) as query:
        pid = query.broker.pid
    assert pid != 1 and Path(f"/proc/{pid}/cmdline").read_bytes().endswith(bytes(path) + b"\0")
    result = bus("daemon", "stop", "--socket", str(path))
    assert (result.code, result.out) == (0, "The daemon has been stopped\n")
    process.wait()


def test_tools_in_a_namespace_of_their_own_see_no_process(path: Path) -> None:
    """The daemon lives outside of theirs: its number is unknown there, and 1 is another process."""
    code = "import sys; from bus_cli.main import main; sys.argv[0] = 'bus'; sys.exit(main())"
    for words, expected in (
        (("doctor", "--exclude-packages"), "[ ok ] daemon: in another PID namespace, protocol 1, 0 nodes"),
        (("daemon", "stop"), "The daemon has been stopped\n"),
    ):
        command = [*INSIDE, sys.executable, "-c", code, *words, "--socket", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert expected in done.stdout, done.stdout + done.stderr
