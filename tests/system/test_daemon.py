"""The program busd, as users run it: its start, its refusals, shortages, its end."""

import asyncio
import contextlib
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

import bus
from bus.msg.std_msgs import String
from bus.qos import History, QoSProfile
from bus.wire import messages as m
from cli import Running
from conftest import WAIT_S, Daemon
from feeding import frame_record
from neighbours import answers, descriptors_of, wait_until
from nursery import cpu_ticks
from raw_peer import HELLO, RawPeer, data
from semantics import until

Start = Callable[..., Daemon]
TICK_S = 1 / os.sysconf("SC_CLK_TCK")


@pytest.fixture(params=["uvloop", "asyncio"])
def loop(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The event loop of daemons that the test starts: with "asyncio" they don't find uvloop."""
    if request.param == "asyncio":
        hidden = tmp_path / "hidden"
        hidden.mkdir()
        (hidden / "uvloop.py").write_text("raise ImportError('hidden by a test')\n")
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(hidden), os.environ.get("PYTHONPATH", "")]))
    return str(request.param)


def run(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs busd to its end."""
    words = ("-m", "busd", *map(str, arguments))
    with patch.dict(os.environ, environment), Running(words) as busd:
        out, err, code = busd.end()
    return subprocess.CompletedProcess(words, code, out, err)


def refusal(*arguments: str | Path, **environment: str) -> str:
    """The single line that busd prints if it cannot start."""
    done = run(*arguments, **environment)
    assert (done.returncode, done.stdout) == (1, ""), done
    (line,) = done.stderr.splitlines()
    assert line.startswith("busd: ")
    return line.removeprefix("busd: ")


def activated(listening: socket.socket, *arguments: str) -> subprocess.Popen[bytes]:
    """busd with an inherited socket, as `systemd-socket-activate` passes it."""
    return subprocess.Popen(
        ["sh", "-c", 'LISTEN_PID=$$ exec "$0" -m busd "$@"', sys.executable, *arguments],
        env={**os.environ, "LISTEN_FDS": "1"},
        stderr=subprocess.PIPE,
        preexec_fn=lambda: os.dup2(listening.fileno(), 3),
        close_fds=False,
    )


class TestOneAtATime:
    def test_a_second_one_is_refused(self, daemon: Daemon) -> None:
        done = run("--socket", daemon.path)
        assert done.returncode == 3
        assert done.stderr == f"busd: busd is already running on {daemon.path} (pid {daemon.pid})\n"
        with RawPeer(daemon.path) as peer:
            peer.hello()

    def test_also_while_the_first_is_stopped(self, daemon: Daemon) -> None:
        daemon.process.send_signal(signal.SIGSTOP)
        assert run("--socket", daemon.path).returncode == 3

    def test_what_a_killed_one_left_is_replaced(self, daemon: Daemon) -> None:
        first = daemon.pid
        daemon.kill()
        assert daemon.path.is_socket()
        daemon.restart()
        with RawPeer(daemon.path) as peer:
            peer.write(HELLO)
            assert peer.expect(m.Hello).pid == daemon.pid != first


class TestEnding:
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
    def test_by_a_signal(self, loop: str, start_daemon: Start, number: signal.Signals) -> None:
        daemon = start_daemon()
        with RawPeer(daemon.path) as peer, RawPeer(daemon.path):
            peer.hello()
            daemon.process.send_signal(number)
            assert peer.receive() is None
            assert daemon.process.wait(WAIT_S) == 0
        assert list(daemon.path.parent.glob("*sock*")) == []
        assert f"stopped: {number.name}" in daemon.log.read_text()

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
    def test_by_a_signal_at_the_first_moment(self, tmp_path: Path, loop: str, number: signal.Signals) -> None:
        """The socket exists before the event loop."""
        path = tmp_path / "s"
        busd = subprocess.Popen([sys.executable, "-m", "busd", "--socket", str(path)], stderr=subprocess.PIPE)
        wait_until(path.exists)
        busd.send_signal(number)
        _, log = busd.communicate(timeout=WAIT_S)
        assert busd.returncode == 0, log
        assert b"Traceback" not in log
        assert not path.exists()

    def test_does_not_wait_for_those_who_do_not_read(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as sleeper, RawPeer(daemon.path) as talker:
            qos = QoSProfile(history=History.KEEP_ALL)
            sleeper.hello().subscription(sleeper.node(), "/t", qos=qos)
            publisher = talker.hello().publisher(talker.node(), "/t").id
            for seq in range(1, 11):
                talker.write(data(publisher, frame_record(bytes(1 << 20), 1), first_seq=seq))
            talker.barrier()
            daemon.process.terminate()
            assert daemon.process.wait(WAIT_S) == 0

    def test_when_asked_over_the_wire(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as peer:
            assert isinstance(peer.hello().ask(m.StopBroker(request=1)), m.Done)
            assert peer.receive() is None
        assert daemon.process.wait(WAIT_S) == 0

    def test_by_itself_when_idle(self, loop: str, tmp_path: Path) -> None:
        done = run("--socket", tmp_path / "s", "--idle-exit", "0.2")
        assert done.returncode == 0
        assert "stopped: idle for 0.2 s" in done.stderr
        assert not (tmp_path / "s").exists()

    def test_not_while_somebody_is_there(self, loop: str, tmp_path: Path) -> None:
        path = tmp_path / "s"
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
            listening.listen()
            with RawPeer(path) as peer:  # connected before busd could be idle
                busd = activated(listening, "--idle-exit", "0.2")
                peer.hello()
                with RawPeer(path) as another:
                    another.hello()
                with pytest.raises(subprocess.TimeoutExpired):
                    busd.wait(0.6)
                peer.barrier()
            _, log = busd.communicate(timeout=WAIT_S)
        assert busd.returncode == 0, log
        assert b"stopped: idle for 0.2 s" in log


class TestReadiness:
    def test_a_line_on_stderr(self, daemon: Daemon) -> None:
        wait_until(lambda: "\n" in daemon.log.read_text())
        assert f"[busd]: listening on {daemon.path} (pid {daemon.pid})\n" in daemon.log.read_text()

    def test_the_service_manager_is_told(
        self, tmp_path: Path, start_daemon: Start, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(tmp_path / "notify"))
            manager.settimeout(WAIT_S)
            monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
            daemon = start_daemon()
            assert "READY=1" in manager.recv(4096).decode().splitlines()
            daemon.process.terminate()
            assert manager.recv(4096) == b"STOPPING=1"

    def test_a_socket_that_was_handed_over(self, tmp_path: Path) -> None:
        """The file stays, because it does not belong to busd."""
        path = tmp_path / "activated.sock"
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
            listening.listen()
            with RawPeer(path) as early:  # connected before busd was there
                busd = activated(listening)
                early.write(HELLO)
                assert early.expect(m.Hello).pid == busd.pid
                busd.terminate()
                _, log = busd.communicate(timeout=WAIT_S)
        assert busd.returncode == 0, log
        assert path.is_socket()


class TestMistakes:
    @pytest.mark.parametrize(
        ("content", "text"),
        [
            ("[limits]\ndepht = 5", "unknown key 'limits.depht'; did you mean 'depth'?"),
            ("limit = 5", "unknown key 'limit'; did you mean 'limits'?"),
            ("[limits]\ndepth = 'deep'", "limits.depth = 'deep': expected `int`, got `str`"),
            ("[limits]\ndepth = 0", "limits.depth = 0: expected `int` >= 1"),
            ("[limits", "not valid TOML"),
            ("\xff", "not valid TOML"),
        ],
    )
    def test_in_the_configuration(self, tmp_path: Path, content: str, text: str) -> None:
        config = tmp_path / "busd.toml"
        config.write_bytes(content.encode("latin-1"))
        said = refusal("--socket", tmp_path / "s", "--config", config)
        assert said.startswith(f"{config}: ")
        assert text in said
        assert not (tmp_path / "s").exists()

    def test_no_configuration_there(self, tmp_path: Path) -> None:
        assert refusal("--config", tmp_path / "no.toml") == (
            f"{tmp_path / 'no.toml'}: can't be read: No such file or directory"
        )

    def test_a_path_too_long(self, tmp_path: Path) -> None:
        assert "may have at most 107" in refusal("--socket", tmp_path / ("x" * 100))

    def test_a_folder_that_is_not_there(self, tmp_path: Path) -> None:
        assert "No such file or directory" in refusal("--socket", tmp_path / "no" / "s")

    def test_something_else_at_the_path(self, tmp_path: Path) -> None:
        (tmp_path / "s").write_text("precious")
        assert "is not a socket" in refusal("--socket", tmp_path / "s")
        assert (tmp_path / "s").read_text() == "precious"

    @pytest.mark.skipif(os.geteuid() != 0, reason="only root can give folders away")
    def test_a_folder_of_another_user(self, tmp_path: Path) -> None:
        strange = tmp_path / "strange"
        strange.mkdir(mode=0o700)
        os.chown(strange, 12345, 12345)
        said = refusal("--socket", strange / "s")
        assert "owner uid 12345" in said
        assert "belongs to another user" in said

    def test_a_default_folder_open_to_others(self, tmp_path: Path) -> None:
        (tmp_path / "busd").mkdir(mode=0o755)
        (tmp_path / "busd").chmod(0o755)
        assert "others may enter it" in refusal(XDG_RUNTIME_DIR=str(tmp_path), BUSD_SOCKET="")

    @pytest.mark.parametrize("domain", ["-1", "65536", "x", "1.5", ""])
    def test_a_domain_that_is_none(self, tmp_path: Path, domain: str) -> None:
        done = run(f"--domain={domain}", XDG_RUNTIME_DIR=str(tmp_path), BUSD_SOCKET="")
        assert done.returncode in (1, 2)
        assert "domain" in done.stderr.splitlines()[-1]

    @pytest.mark.parametrize(
        "arguments",
        [["--no-such"], ["--idle-exit", "0"], ["--idle-exit", "nan"], ["--log-level", "loud"], ["x"]],
    )
    def test_on_the_command_line(self, arguments: list[str]) -> None:
        done = run(*arguments)
        assert done.returncode == 2
        assert done.stderr.startswith("usage: busd ")


class TestOptions:
    def test_help(self) -> None:
        done = run("--help")
        assert (done.returncode, done.stderr) == (0, "")
        for option in (
            "--socket",
            "--domain",
            "--config",
            "--log-level",
            "--idle-exit",
            "$XDG_RUNTIME_DIR/busd",
        ):
            assert option in done.stdout

    @pytest.mark.parametrize("way", ["option", "variable"])
    def test_domains(self, tmp_path: Path, way: str) -> None:
        arguments, environment = (["--domain", "7"], {}) if way == "option" else ([], {"BUSD_DOMAIN": "7"})
        busd = subprocess.Popen(
            [sys.executable, "-m", "busd", *arguments],
            env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "BUSD_SOCKET": "", **environment},
            stderr=subprocess.PIPE,
        )
        try:
            wait_until((tmp_path / "busd" / "7.sock").is_socket)
            assert (tmp_path / "busd").stat().st_mode & 0o777 == 0o700
        finally:
            busd.terminate()
            busd.communicate(timeout=WAIT_S)
        assert busd.returncode == 0

    @pytest.mark.parametrize(
        ("arguments", "content", "says"),
        [
            ([], "", ["INFO"]),
            (["--log-level", "debug"], "", ["DEBUG", "INFO"]),
            (["--log-level", "error"], "", []),
            ([], "log_level = 'fatal'", []),
            (["--log-level", "info"], "log_level = 'fatal'", ["INFO"]),
        ],
    )
    def test_log_level(
        self, tmp_path: Path, start_daemon: Start, arguments: list[str], content: str, says: list[str]
    ) -> None:
        (tmp_path / "busd.toml").write_text(content)
        daemon = start_daemon("--config", str(tmp_path / "busd.toml"), *arguments)
        with RawPeer(daemon.path) as peer:
            peer.hello()
        log = daemon.stop()
        assert sorted({line[1:].partition("]")[0] for line in log.splitlines()}) == says

    def test_a_log_that_nobody_takes(self, tmp_path: Path) -> None:
        path = tmp_path / "s"
        reader, writer = os.pipe()
        busd = subprocess.Popen([sys.executable, "-m", "busd", "--socket", str(path)], stderr=writer)
        os.close(writer)
        os.close(reader)
        wait_until(lambda: answers(path))
        for _ in range(3):
            with RawPeer(path) as peer:
                peer.write(b"garbage!")
                assert peer.fault()
        busd.terminate()
        assert busd.wait(WAIT_S) == 0


class TestShortOfThings:
    def test_out_of_descriptors(self, loop: str, start_daemon: Start) -> None:
        """busd serves its connected clients; further clients wait in the queue until there is room."""
        daemon = start_daemon()
        with RawPeer(daemon.path) as talker, RawPeer(daemon.path) as listener:
            listener.hello().subscription(listener.node(), "/t")
            publisher = talker.hello().publisher(talker.node(), "/t").id
            limit = descriptors_of(daemon.pid) + 3
            resource.prlimit(daemon.pid, resource.RLIMIT_NOFILE, (limit, limit))
            with contextlib.ExitStack() as crowd:
                peers = []
                for _ in range(10):
                    peers.append(crowd.enter_context(RawPeer(daemon.path)))
                    peers[-1].write(HELLO)
                wait_until(lambda: "cannot accept a connection" in daemon.log.read_text())
                for seq in range(1, 100):
                    talker.write(data(publisher, frame_record(b"x", 1), first_seq=seq))
                    talker.barrier()
                before = cpu_ticks(daemon.pid)
                time.sleep(0.5)
                assert cpu_ticks(daemon.pid) - before <= 5, "busd spins"
                for peer in peers[:9]:
                    peer.close()
                peers[9].expect(m.Hello)
            listener.barrier()

    def test_idle_is_idle(self, loop: str, start_daemon: Start) -> None:
        daemon = start_daemon()
        asyncio.run(self.idle(daemon))

    async def idle(self, daemon: Daemon) -> None:
        qos: dict[str, Any] = {"deadline": 5.0, "liveliness_lease_duration": 5.0}
        async with contextlib.AsyncExitStack() as stack:
            for number in range(3):
                node = await stack.enter_async_context(bus.Node(f"idle{number}", arguments=[]))
                publisher = await node.create_publisher(String, "t", bus.QoSProfile(10, **qos))
                subscription = await node.create_subscription(String, "t", bus.QoSProfile(10, **qos))
                publisher.publish(String(data="before the silence"))
            await until(lambda: subscription.statistics().queued)
            async with asyncio.timeout(WAIT_S):
                while not await self.is_quiet(daemon):
                    pass  # on a busy machine the last report of the counters may be pending

    async def is_quiet(self, daemon: Daemon) -> bool:
        """Whether busd and this process are idle for longer than their longest period."""
        before, mine_s = cpu_ticks(daemon.pid), time.process_time()
        await asyncio.sleep(2)
        return cpu_ticks(daemon.pid) - before <= 1 and time.process_time() - mine_s <= 2 * TICK_S
