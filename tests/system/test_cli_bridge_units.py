"""`bus bridge ENGINE install` and `uninstall`: the unit, its command, and systemd's opinion of it."""

import os
import pwd
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from bus_cli.main import run
from conftest import WAIT_S

ME = pwd.getpwuid(os.getuid()).pw_name
NAME = "busd-bridge-zenoh.service"

Bus = Callable[..., tuple[int, str, str]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a user's units."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("BUSD_SOCKET", raising=False)
    monkeypatch.delenv("BUSD_DOMAIN", raising=False)
    return tmp_path / "config" / "systemd" / "user"


@pytest.fixture
def bus(capfd: pytest.CaptureFixture[str]) -> Bus:
    """Runs the command line in this process: exit code, stdout, stderr."""

    def call(*arguments: str) -> tuple[int, str, str]:
        code = run(["bridge", *arguments])
        return code, *capfd.readouterr()

    return call


def test_written_and_removed(folder: Path, bus: Bus) -> None:
    code, said, _ = bus("zenoh", "install", "--listen", "tcp/[::]:7447", "--insecure")
    assert code == 0
    assert said.splitlines() == [
        f"Wrote {folder / NAME}",
        "Now type:",
        "  bus daemon install",
        "  systemctl --user daemon-reload",
        f"  systemctl --user enable --now {NAME}",
    ]
    (folder / "busd.socket").touch()
    assert "bus daemon install" not in bus("zenoh", "install")[1]  # again, after an update
    wanted = folder / "default.target.wants" / NAME
    wanted.parent.mkdir()
    wanted.symlink_to(folder / NAME)
    code, said, _ = bus("zenoh", "uninstall")
    assert (code, said.splitlines()[0]) == (0, f"Removed {folder / NAME}")
    assert not (folder / NAME).exists() and not wanted.is_symlink()
    assert bus("zenoh", "uninstall")[1] == "No unit is installed\n"


def test_the_machines_unit_is_removed_without_the_user(folder: Path, bus: Bus) -> None:
    assert bus("zenoh", "uninstall", "--system", "--domain", "4711")[:2] == (0, "No unit is installed\n")


def test_its_command_has_the_options(folder: Path, bus: Bus, tmp_path: Path) -> None:
    config = tmp_path / "my robot.toml"
    config.write_text('[bridge.ros2]\nid = "other"\n')
    given = ["--domain-id", "5", "--peer", "10.0.0.2", "--peer", "10.0.0.3", "--allow", "/camera/**"]
    given += ["--log-level", "warn"]
    code, _, _ = bus("ros2", "install", *given, "--config", str(config))
    assert code == 0
    (start,) = [
        line.removeprefix("ExecStart=")
        for line in (folder / "busd-bridge-ros2_5.service").read_text().splitlines()
        if line.startswith("ExecStart=")
    ]
    text = (folder / "busd-bridge-ros2_5.service").read_text()
    assert "ExecReload=/bin/kill -HUP $MAINPID\n" in text and "RestartForceExitStatus=SIGHUP\n" in text
    words = shlex.split(start)
    words = words[words.index("bridge") :]
    assert words[:2] == ["bridge", "ros2"]
    pairs = {*zip(words[2::2], words[3::2], strict=True)}
    assert pairs == {*zip(given[::2], given[1::2], strict=True), ("--config", str(config))}


def test_files_of_certificates_are_found_from_anywhere(
    folder: Path, bus: Bus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tls = ("--ca", "ca.pem", "--certificate", "one.pem", "--key", "one.key")
    assert bus("zenoh", "install", "--connect", "tls/other:7447", *tls)[0] == 0
    text = (folder / NAME).read_text()
    assert f"--ca {tmp_path}/ca.pem --certificate {tmp_path}/one.pem --key {tmp_path}/one.key" in text


def test_bridges_to_both_middlewares_of_ros(folder: Path, bus: Bus) -> None:
    assert bus("ros2", "install")[0] == bus("ros2", "install", "--rmw", "zenoh")[0] == 0
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["busd-bridge-rmw-zenoh.service", "busd-bridge-ros2.service"]
    assert "bridge ros2 --rmw zenoh" in (folder / names[0]).read_text()
    assert bus("ros2", "uninstall", "--rmw", "zenoh")[1].startswith(f"Removed {folder / names[0]}\n")
    assert [path.name for path in folder.iterdir()] == names[1:]


def test_bridges_to_two_domains_of_ros(folder: Path, bus: Bus) -> None:
    for options in ((), ("--domain-id", "0"), ("--domain-id", "5"), ("--domain-id", "5", "--domain", "7")):
        assert bus("ros2", "install", *options)[0] == 0
    names = sorted(path.name for path in folder.iterdir())
    assert names == [
        "busd-bridge-ros2.service",
        "busd-bridge-ros2_5-7.service",
        "busd-bridge-ros2_5.service",
    ]
    assert "bridge ros2 --domain-id 5" in (folder / names[2]).read_text()
    assert bus("ros2", "uninstall", "--domain-id", "5")[1].startswith(f"Removed {folder / names[2]}\n")


def test_of_another_domain(folder: Path, bus: Bus) -> None:
    code, said, _ = bus("zenoh", "install", "--domain", "7", "--json")
    assert code == 0
    assert msgspec.json.decode(said)["next"][0] == "bus daemon install --domain 7"
    text = (folder / "busd-bridge-zenoh-7.service").read_text()
    assert "Environment=BUSD_DOMAIN=7\n" in text and "Wants=busd-7.socket\n" in text


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--socket", "/tmp/s"), "not by --socket"),
        (("--user", ME), "--user is for --system"),
        (("--system",), "--system needs --user"),
        (("--system", "--user", "no-such-user"), "there is no user 'no-such-user'"),
        (("--config", "/nowhere.toml"), "/nowhere.toml: can't be read"),
        (("--domain-id", "900"), "--domain-id = 900"),
    ],
)
def test_mistakes_write_nothing(folder: Path, bus: Bus, words: tuple[str, ...], reason: str) -> None:
    code, _, said = bus("ros2", "install", *words)
    assert code and reason in said
    assert not folder.exists()


def test_another_word(folder: Path, bus: Bus) -> None:
    code, _, said = bus("zenoh", "instal")
    assert code == 1 and "'instal' is neither install nor uninstall" in said
    assert not folder.exists()


def test_a_file_of_somebody_else_stays(folder: Path, bus: Bus) -> None:
    folder.mkdir(parents=True)
    (folder / NAME).write_text("[Service]\n")
    code, _, said = bus("zenoh", "install")
    assert code == 1 and "was not written by bus bridge install; move it away first" in said
    assert bus("zenoh", "uninstall")[1] == "No unit is installed\n"
    assert (folder / NAME).read_text() == "[Service]\n"


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="needs systemd-analyze")
@pytest.mark.parametrize("scope", [(), ("--system", "--user", ME)], ids=["user", "system"])
def test_systemd_finds_nothing_wrong(folder: Path, bus: Bus, tmp_path: Path, scope: tuple[str, ...]) -> None:
    _, said, _ = bus("ros2", "install", *scope, "--dry-run", "--json")
    ((_, text),) = msgspec.json.decode(said)["files"].items()
    path = tmp_path / "busd-bridge-ros2.service"
    path.write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "--system" if scope else "--user", "--man=no", "verify", path],
        env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert done.returncode == 0, done
    assert [line for line in (done.stdout + done.stderr).splitlines() if str(tmp_path) in line] == []
