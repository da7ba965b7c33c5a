"""Access to the socket: its mode, its group, its folder; and the owners of a socket that a client accepts."""

import os
import shutil
import signal
import socket
import stat
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bus.errors import BrokerUnavailable, ConfigurationError
from bus.link.reach import Patience, open_socket
from bus_cli.query import Query
from busd.config.access import SocketTable
from busd.server.listener import open_listener
from raw_peer import RawPeer
from users import GUEST, OWNER, STRANGER, TEAM, Guests, acting_as, command, needs_users, rule

pytestmark = needs_users

ANYBODY = rule('users = "*"', "**", "publish", "subscribe", "observe")


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder of root that all users can enter."""
    path = Path(tempfile.mkdtemp(prefix="busd-users-"))
    path.chmod(0o755)
    yield path
    shutil.rmtree(path)


def can_connect(path: Path, uid: int, *groups: int) -> bool:
    with acting_as(uid, *groups), socket.socket(socket.AF_UNIX) as probe:
        return probe.connect_ex(str(path)) == 0


def test_the_kernel_keeps_others_out_by_default(guests: Callable[..., Guests]) -> None:
    busd = guests(ANYBODY, socket="")
    assert stat.S_IMODE(busd.path.stat().st_mode) == 0o600
    assert not can_connect(busd.path, GUEST)
    assert can_connect(busd.path, OWNER) and can_connect(busd.path, 0)
    busd.wait_for_log("[[access]] has rules for other users, but they can't reach")


def test_a_group_is_let_in(guests: Callable[..., Guests]) -> None:
    busd = guests(ANYBODY, socket=f"mode = 0o660\ngroup = {TEAM}")
    found = busd.path.stat()
    assert (stat.S_IMODE(found.st_mode), found.st_uid, found.st_gid) == (0o660, OWNER, TEAM)
    assert can_connect(busd.path, GUEST, TEAM) and can_connect(busd.path, OWNER)
    assert not can_connect(busd.path, GUEST) and not can_connect(busd.path, STRANGER, STRANGER)
    assert "WARN" not in busd.log


def test_a_group_of_others_can_not_be_given(folder: Path) -> None:
    os.chown(folder, OWNER, OWNER)
    config = folder / "busd.toml"
    config.write_text(f"[socket]\nmode = 0o660\ngroup = {TEAM}\n")
    arguments = ("-m", "busd", "--socket", str(folder / "0.sock"), "--config", str(config))
    ended = subprocess.run(command(OWNER, *arguments), capture_output=True, text=True, cwd="/", check=False)
    assert ended.returncode == 1
    assert f"socket.group = {TEAM}: this user is not in that group" in ended.stderr
    assert not [path.name for path in folder.iterdir() if path != config]


def test_a_wrong_group_in_a_reload_changes_nothing(guests: Callable[..., Guests]) -> None:
    busd = guests(ANYBODY, socket=f"mode = 0o660\ngroup = {TEAM}")
    busd._socket = f"mode = 0o666\ngroup = {GUEST}"
    busd.write(ANYBODY)
    busd.process.send_signal(signal.SIGHUP)
    busd.wait_for_log(f"socket.group = {GUEST}: this user is not in that group")
    found = busd.path.stat()
    assert (stat.S_IMODE(found.st_mode), found.st_gid) == (0o660, TEAM)
    assert can_connect(busd.path, GUEST, TEAM)


def test_an_open_door_behind_which_nobody_may_do_anything_is_logged(guests: Callable[..., Guests]) -> None:
    busd = guests()
    busd.wait_for_log("other users can connect to")
    with acting_as(GUEST), RawPeer(busd.path) as peer:
        assert "may not use" in peer.fault()


def test_the_mode_follows_the_file(guests: Callable[..., Guests]) -> None:
    busd = guests(ANYBODY)
    busd._socket = "mode = 0o600"
    busd.reload(ANYBODY)
    assert not can_connect(busd.path, GUEST)


@pytest.mark.parametrize(
    ("socket_mode", "folder_mode", "is_fine"),
    [
        (0o600, 0o700, True),
        (0o600, 0o710, False),
        (0o660, 0o750, True),
        (0o660, 0o755, False),
        (0o660, 0o770, False),
        (0o666, 0o755, True),
        (0o666, 0o777, False),
    ],
)
def test_the_default_folder_may_be_as_open_as_the_socket(
    folder: Path, socket_mode: int, folder_mode: int, is_fine: bool
) -> None:
    default = folder / "busd"
    default.mkdir()
    default.chmod(folder_mode)
    try:
        environ = {"XDG_RUNTIME_DIR": str(folder)}
        with open_listener(rights=SocketTable(mode=socket_mode), environ=environ) as listener:
            assert is_fine
            assert stat.S_IMODE(listener.path.stat().st_mode) == socket_mode
    except ConfigurationError as error:
        assert not is_fine, error


class TestSquatters:
    """Another user has made our default folder first."""

    @pytest.fixture
    def squatted(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """The default path, in a folder of GUEST."""
        monkeypatch.delenv("BUSD_SOCKET", raising=False)
        monkeypatch.delenv("BUSD_AUTOSTART", raising=False)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
        (folder / "busd").mkdir()
        os.chown(folder / "busd", GUEST, GUEST)
        return folder / "busd" / "0.sock"

    @pytest.fixture
    def impostor(self, squatted: Path) -> Iterator[socket.socket]:
        with acting_as(GUEST), socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(squatted))
            listening.listen()
            os.seteuid(0)
            yield listening
            os.seteuid(GUEST)

    async def test_nothing_is_sent_to_their_socket(self, squatted: Path, impostor: socket.socket) -> None:
        with pytest.raises(BrokerUnavailable, match=f"served by user {GUEST}, who should not be there"):
            await open_socket(squatted, Patience())
        with pytest.raises(BrokerUnavailable, match=f"served by user {GUEST}, who should not be there"):
            Query(squatted)
        for _ in range(2):
            theirs, _ = impostor.accept()
            with theirs:
                assert theirs.recv(1) == b""

    async def test_where_the_user_named_it_it_is_his_choice(
        self, squatted: Path, impostor: socket.socket
    ) -> None:
        elsewhere = squatted.with_name("named")
        elsewhere.mkdir()
        path = elsewhere / "0.sock"
        path.symlink_to(squatted)
        (await open_socket(path, Patience())).close()

    async def test_nothing_is_started_in_their_folder(self, squatted: Path) -> None:
        victim = squatted.parent.parent / "victim"
        victim.write_text("precious")
        os.link(victim, squatted.with_suffix(".log"))
        with pytest.raises(BrokerUnavailable, match="remove it, or set BUSD_SOCKET"):
            await open_socket(squatted, Patience())
        assert victim.read_text() == "precious"
        assert [path.name for path in squatted.parent.iterdir()] == ["0.log"]
