"""SIGHUP and `bus daemon reload` read the configuration again; and the meaning of a terminal's end."""

import contextlib
import fcntl
import os
import pty
import signal
import socket
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bus.wire import messages as m
from bus_cli.main import run
from conftest import WAIT_S, Daemon
from neighbours import wait_until
from nursery import until_at_least, until_equal
from raw_peer import RawPeer


@pytest.fixture
def config(tmp_path: Path) -> Path:
    config = tmp_path / "busd.toml"
    config.write_text("")
    return config


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon], config: Path) -> Daemon:
    return start_daemon("--config", str(config))


@pytest.fixture
def peer(daemon: Daemon) -> Iterator[RawPeer]:
    with RawPeer(daemon.path) as peer:
        yield peer.hello()


def hang_up(daemon: Daemon, says: str) -> None:
    """Sends SIGHUP, and waits until the log has the text once more."""
    before = daemon.log.read_text().count(says)
    daemon.process.send_signal(signal.SIGHUP)
    until_equal(before + 1, lambda: daemon.log.read_text().count(says))


class TestAConfiguration:
    def test_holds_from_now_on(self, daemon: Daemon, config: Path, peer: RawPeer) -> None:
        node = peer.node()
        assert isinstance(peer.publisher(node, "/before"), m.Created)
        config.write_text("[limits]\ndepth = 5\n[[topics]]\npattern = '/camera/**'\nmax_depth = 2\n")
        hang_up(daemon, f"reloaded {config}: limits.depth: 100000 -> 5; topics: 0 rules -> 1 rule")
        refused = peer.publisher(node, "/after")
        assert isinstance(refused, m.Refused)
        assert "limit of 5" in refused.text
        assert peer.publisher(node, "/camera/left").depth == 2
        config.write_text("[[topics]]\npattern = '/camera/**'\nmax_depth = 3\n")
        hang_up(daemon, f"reloaded {config}: limits.depth: 5 -> 100000; topics: 1 rule, changed")

    def test_of_bridges_is_theirs(self, daemon: Daemon, config: Path) -> None:
        config.write_text("[bridge.zenoh]\nconnect = 'tcp/robot:7447'\n[bridge.ros2]\ndomain = 1\n")
        reads = "changed; a bridge reads it when it starts or reloads"
        hang_up(daemon, f"reloaded {config}: bridge.zenoh, bridge.ros2: {reads}\n")
        config.write_text("log_level = 'debug'\n[bridge.zenoh]\nconnect = 'tcp/robot:7447'\n")
        hang_up(daemon, f"log_level: info -> debug; bridge.ros2: {reads}\n")
        config.write_text("log_level = 'debug'\n")
        hang_up(daemon, f"reloaded {config}: bridge.zenoh: {reads}\n")
        config.write_text("bridge = 3\nlog_level = 'debug'\n")
        hang_up(daemon, f"reloaded {config}: bridge: {reads}\n")
        hang_up(daemon, "nothing has changed")

    def test_may_be_another_log(self, daemon: Daemon, config: Path, peer: RawPeer) -> None:
        config.write_text("log_format = 'json'\n")
        hang_up(daemon, '"severity": "INFO", "name": "busd", "message": "reloaded ')
        config.write_text("log_level = 'error'\n")
        done = peer.ask(m.Reload(request=1))
        assert done == m.Done(request=1, text="log_level: info -> error; log_format: json -> text")
        config.write_text("log_level = 'wrong'\n")
        hang_up(daemon, "[ERROR]")
        assert "info -> error" not in daemon.log.read_text()

    @pytest.mark.parametrize(
        ("content", "text"),
        [
            ("[limits]\ndepht = 5", "unknown key 'limits.depht'; did you mean 'depth'?"),
            ("[limits", "not valid TOML"),
            ("log_format = 'xml'", "log_format = 'xml': expected one of text, json"),
            (None, "can't be read: No such file or directory"),
        ],
    )
    def test_that_is_wrong_changes_nothing(
        self, daemon: Daemon, config: Path, peer: RawPeer, content: str | None, text: str
    ) -> None:
        config.write_text("[limits]\ndepth = 15\n")
        hang_up(daemon, "depth: 100000 -> 15")
        config.unlink() if content is None else config.write_text(content)
        hang_up(daemon, f"the configuration stays as it was: {config}: {text}")
        assert peer.publisher(peer.node(), "/t").depth == 10
        config.write_text("[limits]\ndepth = 15\n")
        hang_up(daemon, "nothing has changed")

    def test_what_means_nothing_in_it_is_said_at_each_reload(self, daemon: Daemon, config: Path) -> None:
        rule = (
            f"[[access]]\ntopics = '**'\nactions = 'observe'\nusers = {os.getuid()}\nshared_memory = true\n"
        )
        config.write_text(rule)
        says = "access[0].shared_memory = true has no effect any more"
        hang_up(daemon, says)
        hang_up(daemon, says)
        assert "nothing has changed" in daemon.log.read_text()

    def test_where_there_is_none(self, start_daemon: Callable[..., Daemon]) -> None:
        hang_up(start_daemon(), "started without --config, so there is nothing to reload")

    def test_programs_that_ask_for_it_again_and_again_do_not_fill_the_log(
        self, daemon: Daemon, config: Path, peer: RawPeer
    ) -> None:
        """The answers have the details that the log omits."""
        config.write_text("[limits]\ndepht = 5\n")
        peer.send(*(m.Reload(request=number) for number in range(1000, 1500)))
        refusals = [peer.expect(m.Refused) for _ in range(500)]
        assert sum("unknown key 'limits.depht'" in one.text for one in refusals) < 100
        assert {one.again for one in refusals if "try again" in one.text} == {True}
        log = daemon.log.read_text()
        assert log.count("the configuration stays as it was") == 1
        hang_up(daemon, "the configuration stays as it was")  # the sender of a signal gets no other answer

    def test_the_service_manager_is_told(
        self,
        tmp_path: Path,
        config: Path,
        start_daemon: Callable[..., Daemon],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(tmp_path / "notify"))
            manager.settimeout(WAIT_S)
            monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
            monkeypatch.setenv("WATCHDOG_USEC", "3600000000")
            daemon = start_daemon("--config", str(config))
            assert manager.recv(4096).startswith(b"READY=1\n")
            assert manager.recv(4096) == b"WATCHDOG=1"
            daemon.process.send_signal(signal.SIGHUP)
            assert manager.recv(4096).startswith(b"RELOADING=1\nMONOTONIC_USEC=")
            assert manager.recv(4096) == b"READY=1"

    def test_the_watchdog_is_fed(
        self, tmp_path: Path, start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(tmp_path / "notify"))
            manager.settimeout(WAIT_S)
            monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
            monkeypatch.setenv("WATCHDOG_USEC", "100000")
            start_daemon()
            assert manager.recv(4096).startswith(b"READY=1\n")
            assert [manager.recv(4096) for _ in range(3)] == [b"WATCHDOG=1"] * 3


class TestTheVerb:
    def test_says_what_has_changed(
        self, daemon: Daemon, config: Path, capfd: pytest.CaptureFixture[str]
    ) -> None:
        config.write_text("[limits]\ndepth = 5\n")
        assert run(["daemon", "reload"]) == 0
        said = capfd.readouterr().out
        assert said == "The daemon has reloaded its configuration: limits.depth: 100000 -> 5\n"

    def test_says_what_is_wrong(
        self, daemon: Daemon, config: Path, capfd: pytest.CaptureFixture[str]
    ) -> None:
        config.write_text("[limits]\ndepth = 0\n")
        assert run(["daemon", "reload"]) == 1
        assert f"{config}: limits.depth = 0: expected `int` >= 1" in capfd.readouterr().err

    @pytest.mark.parametrize("verb", ["reload", "restart"])
    def test_where_none_runs(self, socket_path: Path, verb: str, capfd: pytest.CaptureFixture[str]) -> None:
        assert run(["daemon", verb]) == 1
        assert "The daemon is not running" in capfd.readouterr().err

    def test_restart(self, daemon: Daemon, config: Path, capfd: pytest.CaptureFixture[str]) -> None:
        config.write_text("[limits]\ndepth = 0\n")
        assert run(["daemon", "restart"]) == 1
        assert "expected `int` >= 1" in capfd.readouterr().err
        config.write_text("[limits]\ndepth = 5\n")
        assert run(["daemon", "restart"]) == 0
        assert capfd.readouterr().out == "The daemon has been restarted\n"
        with RawPeer(daemon.path) as peer:
            assert isinstance(peer.hello().publisher(peer.node(), "/t"), m.Refused)


class InATerminal:
    """busd as a user starts it by hand: it has a terminal of its own, and ends with that."""

    def __init__(self, folder: Path, config: Path, *, shielded: bool = False) -> None:
        self.path = folder / "terminal.sock"
        self.log = folder / "terminal.log"
        self.ours, theirs = pty.openpty()

        def take_terminal() -> None:
            os.setsid()
            fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)
            if shielded:
                signal.signal(signal.SIGHUP, signal.SIG_IGN)  # nohup

        arguments = ["--socket", str(self.path), "--config", str(config)]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "busd", *arguments],
                stdin=theirs,
                stderr=log,
                preexec_fn=take_terminal,
                pass_fds=[theirs],
            )
        os.close(theirs)
        wait_until(lambda: "listening on" in self.log.read_text())

    def hang_up(self) -> None:
        before = self._reloads()
        self.process.send_signal(signal.SIGHUP)
        until_at_least(before + 1, self._reloads)

    def close_terminal(self) -> None:
        os.close(self.ours)
        self.ours = -1

    def end(self) -> None:
        if self.ours >= 0:
            self.close_terminal()
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()
        self.process.wait(WAIT_S)

    def _reloads(self) -> int:
        return self.log.read_text().count("nothing has changed")


class TestInATerminal:
    def test_a_signal_is_a_signal(self, tmp_path: Path, config: Path) -> None:
        """Without a terminal's end SIGHUP only reloads; the end of the terminal stops busd in order."""
        busd = InATerminal(tmp_path, config)
        try:
            busd.hang_up()
            busd.close_terminal()
            assert busd.process.wait(WAIT_S) == 0
            assert "stopped: its terminal was closed" in busd.log.read_text()
            assert not busd.path.exists()
        finally:
            busd.end()

    def test_nohup(self, tmp_path: Path, config: Path) -> None:
        busd = InATerminal(tmp_path, config, shielded=True)
        try:
            busd.close_terminal()
            busd.hang_up()
            with RawPeer(busd.path) as peer:
                peer.hello()
        finally:
            busd.end()
