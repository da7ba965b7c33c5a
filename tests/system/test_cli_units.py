"""`bus daemon install` and `uninstall`: the systemd units, as systemd itself reads them."""

import os
import pwd
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from bus.wire import messages as m
from bus_cli.daemon.units import OURS, Units, systemd_version
from bus_cli.main import run
from busd.core.limits import Limits
from conftest import WAIT_S
from neighbours import answers, wait_until
from raw_peer import HELLO, RawPeer

ME = pwd.getpwuid(os.getuid()).pw_name
MOST_EXPOSURE = 20
"""In tenths; systemd calls up to 4.9 "OK"."""

needs_analyze = pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="needs systemd-analyze")

Bus = Callable[..., tuple[int, str, str]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a user's units."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("BUSD_SOCKET", raising=False)
    monkeypatch.delenv("BUSD_DOMAIN", raising=False)
    return tmp_path / "config" / "systemd" / "user"


@pytest.fixture
def bus(capfd: pytest.CaptureFixture[str]) -> Bus:
    """Runs the command line in this process: exit code, stdout, stderr."""

    def call(*arguments: str) -> tuple[int, str, str]:
        code = run(["daemon", *arguments])
        return code, *capfd.readouterr()

    return call


def analyze(*arguments: str) -> str:
    done = subprocess.run(
        ["systemd-analyze", *arguments], capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert done.returncode == 0, done
    return done.stdout + done.stderr


def write(folder: Path, texts: dict[Path, str]) -> list[str]:
    """Writes the texts as files with their names; the paths."""
    for path, text in texts.items():
        (folder / path.name).write_text(text)
    return [str(folder / path.name) for path in texts]


class TestForAUser:
    def test_written_and_removed(self, folder: Path, bus: Bus) -> None:
        code, said, _ = bus("install")
        assert code == 0
        assert said.splitlines() == [
            f"Wrote {folder / 'busd.socket'}",
            f"Wrote {folder / 'busd.service'}",
            "Now type:",
            "  systemctl --user daemon-reload",
            "  systemctl --user enable --now busd.socket",
        ]
        assert "ListenStream=%t/busd/0.sock\n" in (folder / "busd.socket").read_text()
        assert bus("install")[0] == 0  # again, after an update
        wanted = folder / "sockets.target.wants" / "busd.socket"
        wanted.parent.mkdir()
        wanted.symlink_to(folder / "busd.socket")
        code, said, _ = bus("uninstall")
        assert (code, said.splitlines()[0]) == (0, f"Removed {folder / 'busd.socket'}")
        assert [path for path in folder.rglob("*") if not path.is_dir()] == []
        assert bus("uninstall")[1] == "No units are installed\n"

    def test_one_that_runs_must_leave_first(self, folder: Path, tmp_path: Path, bus: Bus) -> None:
        busd = subprocess.Popen([sys.executable, "-m", "busd"], stderr=subprocess.PIPE)
        try:
            wait_until(lambda: answers(tmp_path / "busd" / "0.sock"))
            code, said, _ = bus("--json", "install")
        finally:
            busd.terminate()
            busd.communicate(timeout=WAIT_S)
        assert code == 0
        assert msgspec.json.decode(said)["next"][0] == "bus daemon stop"

    def test_of_another_domain(self, folder: Path, bus: Bus) -> None:
        assert bus("install", "--domain", "7")[0] == 0
        assert sorted(path.name for path in folder.iterdir()) == ["busd-7.service", "busd-7.socket"]
        assert "%t/busd/7.sock" in (folder / "busd-7.socket").read_text()
        assert " --domain 7\n" in (folder / "busd-7.service").read_text()

    def test_with_a_configuration(self, folder: Path, tmp_path: Path, bus: Bus) -> None:
        config = tmp_path / 'my "robot"\n100%.toml'
        config.touch()
        assert bus("install", "--config", str(config))[0] == 0
        quoted = str(config).replace('"', '\\"').replace("%", "%%").replace("\n", "\\n")
        assert f'--config "{quoted}"\n' in (folder / "busd.service").read_text()

    def test_with_a_path_that_is_not_utf_8(self, folder: Path, tmp_path: Path, bus: Bus) -> None:
        config = tmp_path / os.fsdecode(b"b\xff.toml")
        config.touch()
        assert bus("install", "--config", str(config))[0] == 0
        assert b"/b\xff.toml\n" in (folder / "busd.service").read_bytes()

    def test_a_dry_run_writes_nothing(self, folder: Path, bus: Bus) -> None:
        code, said, _ = bus("install", "--dry-run")
        assert code == 0
        assert [line for line in said.splitlines() if line.startswith(f"# {folder}")] == [
            f"# {folder / 'busd.socket'}",
            f"# {folder / 'busd.service'}",
        ]
        code, said, _ = bus("--json", "install", "--dry-run")
        assert code == 0
        files = msgspec.json.decode(said)["files"]
        assert [*files] == [str(folder / "busd.socket"), str(folder / "busd.service")]
        assert not folder.exists()

    @pytest.mark.parametrize("text", [b"[Socket]\n", b"\xff\xfe"])
    def test_somebody_else_s_are_left_alone(self, folder: Path, bus: Bus, text: bytes) -> None:
        folder.mkdir(parents=True)
        (folder / "busd.socket").write_bytes(text)
        code, _, said = bus("install")
        assert code == 1
        assert "was not written by bus daemon install" in said
        assert bus("uninstall")[1] == "No units are installed\n"
        assert (folder / "busd.socket").read_bytes() == text


class TestMistakes:
    @pytest.mark.parametrize(
        ("arguments", "text"),
        [
            (["--user", ME], "--user and --group are for --system"),
            (["--system"], "--system needs --user"),
            (["--system", "--user", "no such user"], "there is no user 'no such user'"),
            (["--system", "--user", ME, "--group", "no such group"], "there is no group 'no such group'"),
            (["--config", "no.toml"], "no.toml is not there"),
            (["--socket", "/tmp/s"], "chosen by --domain and --system"),
        ],
    )
    def test_are_named(self, folder: Path, bus: Bus, arguments: list[str], text: str) -> None:
        code, _, said = bus("install", *arguments)
        assert code == 1
        assert text in said
        assert not folder.exists()

    def test_of_a_configuration(self, folder: Path, tmp_path: Path, bus: Bus) -> None:
        """At once, not at the first connection."""
        config = tmp_path / "busd.toml"
        config.write_text("[limits]\ndepht = 3\n")
        code, _, said = bus("install", "--config", str(config))
        assert code == 1
        assert said == f"{config}: unknown key 'limits.depht'; did you mean 'depth'?\n"
        assert not folder.exists()

    def test_not_of_where_we_are(
        self, folder: Path, tmp_path: Path, bus: Bus, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """Files of the current folder and this terminal's bus have no effect."""
        config = tmp_path / "busd.toml"
        config.write_text("[limits]\ndepht = 3\n")
        (tmp_path / "busd.py").touch()
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("BUSD_SOCKET", "x" * 200)
        monkeypatch.setenv("BUSD_DOMAIN", "many")
        assert bus("install", "--domain", "3", "--config", str(config))[0] == 1
        config.write_text("")
        assert bus("install", "--domain", "3", "--config", str(config))[0] == 0
        assert (folder / "busd-3.service").is_file()


class TestAsSystemdReadsThem:
    @needs_analyze
    @pytest.mark.parametrize("version", [systemd_version(), None], ids=["installed", "unknown"])
    @pytest.mark.parametrize("scope", ["user", "system"])
    def test_nothing_is_wrong(self, folder: Path, tmp_path: Path, scope: str, version: int | None) -> None:
        units = Units(user=ME, group=ME) if scope == "system" else Units()
        paths = write(tmp_path, units.texts(units.command(), version))
        said = analyze(f"--{scope}", "--man=no", "verify", *paths)
        assert [line for line in said.splitlines() if str(tmp_path) in line] == []

    @needs_analyze
    def test_that_of_the_machine_is_closed(self, tmp_path: Path) -> None:
        units = Units(user=ME, group=ME)
        _, service = write(tmp_path, units.texts(units.command(), systemd_version()))
        threshold = f"--threshold={MOST_EXPOSURE}"
        analyze("security", "--offline=yes", "--no-pager", threshold, service)

    @pytest.mark.parametrize(
        ("units", "users"), [(Units(), 1), (Units(user=ME, group=ME), 2)], ids=["user", "system"]
    )
    def test_memory_is_bounded_above_what_hostile_users_make_busd_hold(
        self, units: Units, users: int
    ) -> None:
        """The machine's busd has two users: its own and a guest. A fifth is left for allocators."""
        (_, service) = units.texts("busd", None).values()
        (most,) = re.findall(r"^MemoryMax=(\d+)G$", service, re.MULTILINE)
        held = users * Limits().bytes_per_user
        assert held < 0.8 * (int(most) << 30) < 2 * held
        assert "\nTasksMax=" in service

    @pytest.mark.parametrize(
        ("version", "type_", "reloads"),
        [(None, "notify", 1), (252, "notify", 1), (253, "notify-reload", 0)],
    )
    def test_reload(self, version: int | None, type_: str, reloads: int) -> None:
        (_, service) = Units().texts("busd", version).values()
        assert service.startswith(OURS)
        assert f"\nType={type_}\n" in service
        assert service.count("\nExecReload=") == reloads


@pytest.mark.skipif(not shutil.which("systemd-socket-activate"), reason="needs systemd-socket-activate")
def test_systemd_keeps_the_socket(tmp_path: Path) -> None:
    """The first connection starts busd; after a restart it has the same socket."""
    path = tmp_path / "s"
    manager = subprocess.Popen(
        ["systemd-socket-activate", f"--listen={path}", sys.executable, "-m", "busd"],
        stderr=subprocess.PIPE,
        env=dict(os.environ),
    )
    try:
        wait_until(lambda: answers(path))
        inode = path.stat().st_ino
        for request in range(1, 3):
            with RawPeer(path) as peer:
                peer.write(HELLO)
                assert peer.expect(m.Hello).pid == manager.pid  # it has become busd
                peer.ask(m.StopBroker(request=request, restart=True))
                assert peer.receive() is None
        with RawPeer(path) as peer:
            peer.hello()
        assert path.stat().st_ino == inode
    finally:
        manager.terminate()
        _, log = manager.communicate(timeout=WAIT_S)
    assert manager.returncode == 0, log
    assert path.is_socket()
