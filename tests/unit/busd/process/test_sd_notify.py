"""busd under a service manager: busd.process.sd_notify, and the socket that the manager passes."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.errors import ConfigurationError
from busd.process import sd_notify as notify_module
from busd.process.sd_notify import READY, STOPPING, notify, status
from busd.server.listener import open_listener
from rows import for_each


@pytest.fixture
def manager() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.settimeout(10)
        yield listening


@pytest.mark.parametrize("state", [READY, STOPPING, "READY=1\nSTATUS=two peers, ä"])
def test_a_state_arrives(manager: socket.socket, tmp_path: Path, state: str) -> None:
    path = str(tmp_path / "notify")
    manager.bind(path)
    assert notify(state, {"NOTIFY_SOCKET": path})
    assert manager.recv(4096).decode() == state


@pytest.mark.skipif(not Path("/proc/net/unix").exists(), reason="abstract sockets are Linux's")
def test_abstract_socket(manager: socket.socket) -> None:
    name = f"busd-test-{os.getpid()}"
    manager.bind(f"\0{name}")
    assert notify(READY, {"NOTIFY_SOCKET": f"@{name}"})
    assert manager.recv(4096) == b"READY=1"


def test_the_environment_is_the_processes_own(
    manager: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(tmp_path / "notify")
    manager.bind(path)
    monkeypatch.setenv("NOTIFY_SOCKET", path)
    assert notify(READY)
    assert manager.recv(4096) == b"READY=1"


@for_each("address", ["", "relative", "vsock:2:1", "/nowhere/notify", "@busd-nobody", "/" + "x" * 200])
def test_nobody_listens(address: str) -> None:
    assert not notify(READY, {"NOTIFY_SOCKET": address})
    assert not notify(READY, {})


def test_a_manager_that_went_away(manager: socket.socket, tmp_path: Path) -> None:
    path = str(tmp_path / "notify")
    manager.bind(path)
    manager.close()
    assert not notify(READY, {"NOTIFY_SOCKET": path})


def test_a_manager_that_does_not_read_holds_nobody_up(
    manager: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notify_module, "_SEND_TIMEOUT_S", 0.01)
    path = str(tmp_path / "notify")
    manager.bind(path)
    sent = 0
    while notify(READY, {"NOTIFY_SOCKET": path}):
        sent += 1
    assert sent > 0


def test_a_status_is_one_line() -> None:
    assert status("3 peers,\n 7 topics\nREADY=0") == "STATUS=3 peers, 7 topics READY=0"


# --- socket activation

ACTIVATED = """
import os, sys
from busd.server.listener import open_listener
os.dup2(int(sys.argv[1]), 3)
os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS="1", LISTEN_FDNAMES="bus")
try:
    with open_listener() as listener:
        print(listener.path, listener.activated, listener.socket.getblocking(), os.get_inheritable(3))
        print([name for name in os.environ if name.startswith("LISTEN_")])
        listener.socket.accept()[0].sendall(b"hello")
except ValueError as error:
    print(error)
"""


def activate(descriptor: int) -> list[str]:
    """The output of a daemon that receives this descriptor."""
    ended = subprocess.run(
        [sys.executable, "-c", ACTIVATED, str(descriptor)],
        capture_output=True,
        check=True,
        text=True,
        pass_fds=[descriptor],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    return ended.stdout.splitlines()


def test_a_passed_socket_is_used_and_left_in_place(tmp_path: Path) -> None:
    path = tmp_path / "0.sock"
    kind = (socket.AF_UNIX, socket.SOCK_STREAM)
    with socket.socket(*kind) as listening, socket.socket(*kind) as client:
        listening.bind(str(path))
        listening.listen()
        client.connect(str(path))
        assert activate(listening.fileno()) == [f"{path} True False False", "[]"]
        assert client.recv(16) == b"hello"
    assert list(tmp_path.iterdir()) == [path]


@for_each(
    ("family", "kind"),
    [
        (socket.AF_UNIX, socket.SOCK_STREAM),  # does not listen
        (socket.AF_UNIX, socket.SOCK_DGRAM),
        (socket.AF_INET, socket.SOCK_STREAM),
    ],
)
def test_a_passed_socket_of_the_wrong_kind(family: socket.AddressFamily, kind: socket.SocketKind) -> None:
    with socket.socket(family, kind) as wrong:
        (said,) = activate(wrong.fileno())
    assert said == "LISTEN_FDS: busd needs a listening UNIX stream socket (ListenStream=/...)"


def test_a_passed_file(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w") as wrong:
        (said,) = activate(wrong.fileno())
    assert said == "descriptor 3 of LISTEN_FDS: Socket operation on non-socket"


@pytest.mark.parametrize(("pid", "count"), [("", "1"), ("1", "1"), ("x", "1"), ("ours", "0")])
def test_no_socket_is_passed_to_us(tmp_path: Path, pid: str, count: str) -> None:
    pid = str(os.getpid()) if pid == "ours" else pid
    environ = {"LISTEN_PID": pid, "LISTEN_FDS": count, "OTHER": "stays"}
    with open_listener(tmp_path / "0.sock", environ=environ) as listener:
        assert not listener.activated
    assert environ == {"OTHER": "stays"}


@pytest.mark.parametrize("count", ["2", "-1", "x", ""])
def test_any_other_number_of_sockets_is_refused(tmp_path: Path, count: str) -> None:
    environ = {"LISTEN_PID": str(os.getpid()), "LISTEN_FDS": count}
    with pytest.raises(ConfigurationError, match=f"LISTEN_FDS={count}: busd takes one socket"):
        open_listener(tmp_path / "0.sock", environ=environ)
