"""A busd that restarts: its process and socket stay, every connect succeeds, and no message is lost."""

import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bus.base.version import RELEASE
from bus.wire import messages as m
from conftest import WAIT_S, Daemon
from neighbours import wait_until, with_limits
from nursery import Nursery, until_equal
from raw_peer import HELLO, RawPeer
from survivors import Ear

RESTARTS = 2
KNOCK_S = WAIT_S / 400
"""Rare enough that all attempts within a test's patience fit into the backlog."""

DEPTH = 50_000
"""A talker of this file publishes so many in 50 s."""


def restart(path: Path) -> m.Hello:
    """Restarts busd; the Hello of the new one."""
    with RawPeer(path) as peer:
        answer = peer.hello().ask(m.StopBroker(request=1, restart=True))
        assert isinstance(answer, m.Done), answer
        assert peer.receive() is None
    with RawPeer(path) as peer:
        peer.write(HELLO)
        return peer.expect(m.Hello)


def until_alone(peer: RawPeer) -> None:
    """Wait until busd has noticed the end of all earlier connections."""

    def peers() -> int:
        answer = peer.ask(m.GetPeers(request=peer.request()))
        assert isinstance(answer, m.Peers), answer
        return len(answer.peers)

    until_equal(1, peers)


def restarts_said(daemon: Daemon) -> int:
    return daemon.log.read_text().count("[busd]: restarting: asked by ")


class TestTheProcess:
    def test_stays_with_its_socket_and_lock(self, daemon: Daemon) -> None:
        def look() -> list[tuple[int, int]]:
            files = daemon.path, daemon.path.with_name(f"{daemon.path.name}.lock")
            return [(found.st_ino, found.st_mode) for found in (file.stat() for file in files)]

        before = look()
        hello = restart(daemon.path)
        assert (hello.pid, hello.release) == (daemon.pid, RELEASE)
        assert look() == before
        second = subprocess.run(
            [sys.executable, "-m", "busd", "--socket", str(daemon.path)],
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
        assert (second.returncode, f"(pid {daemon.pid})" in second.stderr) == (3, True), second
        assert restart(daemon.path).pid == daemon.pid
        daemon.stop()
        assert list(daemon.path.parent.glob("*sock*")) == []
        assert restarts_said(daemon) == 2

    def test_leaves_nothing_open(self, daemon: Daemon) -> None:
        def look() -> list[str]:
            links = [(entry.name, entry) for entry in Path(f"/proc/{daemon.pid}/fd").iterdir()]
            return sorted(os.readlink(entry).partition(":[")[0] for _, entry in links)  # noqa: PTH115

        restart(daemon.path)
        with RawPeer(daemon.path) as peer:
            until_alone(peer.hello())
            before = look()
        restart(daemon.path)
        with RawPeer(daemon.path) as peer:
            until_alone(peer.hello())
            until_equal(before, look)

    def test_takes_nobody_for_gone_meanwhile(self, daemon: Daemon) -> None:
        """At any moment, each connection is served by the old busd or by the new one."""
        served = 0
        failures: list[BaseException] = []
        is_over = threading.Event()

        def knock() -> None:
            nonlocal served
            try:
                while not is_over.is_set():
                    with socket.socket(socket.AF_UNIX) as caller:
                        caller.settimeout(WAIT_S)
                        caller.connect(str(daemon.path))
                    served += 1
                    time.sleep(KNOCK_S)
            except OSError as error:
                failures.append(error)

        knocking = threading.Thread(target=knock)
        knocking.start()
        try:
            for _ in range(2):
                restart(daemon.path)
                before = served
                wait_until(lambda before=before: served > before or failures)  # type: ignore[misc]
        finally:
            is_over.set()
            knocking.join()
        assert failures == []

    def test_a_signal_meanwhile_is_not_lost(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as peer:
            assert isinstance(peer.hello().ask(m.StopBroker(request=1, restart=True)), m.Done)
            assert peer.receive() is None
            daemon.process.terminate()
        assert daemon.process.wait(WAIT_S) == 0
        assert not daemon.path.exists()


class TestRefusal:
    def test_a_wrong_configuration_leaves_all_as_it_was(self, tmp_path: Path, socket_path: Path) -> None:
        config = tmp_path / "busd.toml"
        config.write_text("")
        daemon = Daemon(socket_path, "--config", str(config))
        try:
            with RawPeer(daemon.path) as peer:
                peer.hello()
                config.write_text("[limits]\ndepht = 5\n")
                answer = peer.ask(m.StopBroker(request=1, restart=True))
                assert isinstance(answer, m.Refused)
                text = f"{config}: unknown key 'limits.depht'; did you mean 'depth'?"
                assert answer.text == text
                peer.barrier()
                config.write_text("[limits]\ndepth = 5\n")
                assert isinstance(peer.ask(m.StopBroker(request=2, restart=True)), m.Done)
            with RawPeer(daemon.path) as peer:
                assert "limit of 5" in peer.hello().publisher(peer.node(), "/t").text
        finally:
            log = daemon.stop()
        assert f"no restart: {text}" in log


@pytest.fixture
def nursery(route: str, daemon: Daemon, tmp_path: Path) -> Iterator[Nursery]:
    with Nursery(tmp_path, random.Random(time.time_ns())) as nursery:
        yield nursery


class TestStreams:
    @with_limits(drain_s=60)  # so that busd cuts off no process that is delayed
    def test_lose_nothing(self, daemon: Daemon, nursery: Nursery, route: str) -> None:
        """Streams with keep all, and with enough depth, by either route: no message is lost or repeated."""
        notes = "publish" if route == "shm" else "flush"
        listener = nursery.listener(Ear(), Ear(DEPTH)).ready()
        talkers = [
            nursery.talker(depth=0, burst=100, pause_s=0.01, notes=notes).ready(),
            nursery.talker(depth=DEPTH, pause_s=0.01, notes=notes).ready(),
        ]
        for _ in range(RESTARTS):
            for talker in talkers:
                listener.hears(talker, 100)
            restart(daemon.path)
        for talker in talkers:
            listener.hears(talker, 100)
        listener.has_heard_all(*((talker, talker.ask("stop")) for talker in talkers))
        assert restarts_said(daemon) == RESTARTS

    @with_limits(drain_s=0.1, keep_all_window_messages=5_000)
    def test_lose_nothing_for_one_that_sleeps(self, daemon: Daemon, nursery: Nursery) -> None:
        """A keep-all publisher resends samples that busd could not deliver in time."""
        listener = nursery.listener(Ear()).ready()
        # Its window is full long before the lease of the stopped listener ends, even on a busy machine.
        talker = nursery.talker(depth=0, burst=1_000, notes="flush").ready()
        listener.hears(talker, 100)
        listener.stop()
        wait_until(lambda: talker.waits)
        restart(daemon.path)
        listener.resume()
        listener.hears(talker, 100)
        listener.has_heard_all((talker, talker.ask("stop")))


class TestServiceManagers:
    def test_the_socket_that_was_passed_is_passed_on(self, tmp_path: Path) -> None:
        path = tmp_path / "activated.sock"
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
            listening.listen()
            busd = subprocess.Popen(
                ["sh", "-c", 'LISTEN_PID=$$ LISTEN_FDS=1 exec "$0" -m busd', sys.executable],
                stderr=subprocess.PIPE,
                preexec_fn=lambda: os.dup2(listening.fileno(), 3),
                close_fds=False,
            )
            try:
                for _ in range(2):
                    assert restart(path).pid == busd.pid
            finally:
                busd.terminate()
                _, log = busd.communicate(timeout=WAIT_S)
        assert busd.returncode == 0, log
        assert path.is_socket()

    def test_are_told(
        self, tmp_path: Path, start_daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(tmp_path / "notify"))
            manager.settimeout(WAIT_S)
            monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
            daemon = start_daemon()
            assert manager.recv(4096).startswith(b"READY=1\n")
            restart(daemon.path)
            assert manager.recv(4096).startswith(b"RELOADING=1\nMONOTONIC_USEC=")
            assert manager.recv(4096).startswith(b"READY=1\n")
            daemon.process.send_signal(signal.SIGTERM)
            assert manager.recv(4096) == b"STOPPING=1"
