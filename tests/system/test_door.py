"""Connecting to busd: storms of connections, a full backlog, and clients that wait for their turn."""

import asyncio
import contextlib
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest

import bus
from bus.errors import BrokerUnavailable
from bus.link import query, reach
from bus.wire import messages as m
from bus_cli.query import Query
from busd.core.anteroom import MOST_WAITING
from conftest import WAIT_S, Daemon
from neighbours import resident_bytes, with_limits
from raw_peer import HELLO, RawPeer
from semantics import until

MiB = 1 << 20

STORM = """
import os, socket, struct, sys
garbage = [os.urandom(3000), struct.pack("<I", 0xffffffff) + bytes(100), b"GET / HTTP/1.1"]
words = [*garbage, b"", bytes.fromhex(sys.argv[2])]
held, at = [], 0
while True:
    one, at = socket.socket(socket.AF_UNIX), at + 1
    one.setblocking(False)
    try:
        one.connect(sys.argv[1])
        one.send(words[at % len(words)])
    except OSError:
        pass
    if at % 7 == 0:
        held.append(one)
    if len(held) > 100:
        held.pop(0).close()
"""
"""Sends garbage, nothing, or a Hello and reads no answer, as fast as it can; keeps some connections."""


@contextlib.contextmanager
def storms(daemon: Daemon, number: int) -> Iterator[None]:
    command = [sys.executable, "-c", STORM, str(daemon.path), HELLO.hex()]
    processes = [subprocess.Popen(command) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            assert process.poll() is None
            process.kill()
            process.wait()


@contextlib.contextmanager
def full_backlog(daemon: Daemon) -> Iterator[None]:
    """A stopped busd whose backlog is full."""
    daemon.process.send_signal(signal.SIGSTOP)
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(BlockingIOError):
            while True:
                guest = stack.enter_context(socket.socket(socket.AF_UNIX))
                guest.setblocking(False)
                guest.connect(str(daemon.path))
        try:
            yield
        finally:
            daemon.process.send_signal(signal.SIGCONT)


@pytest.mark.usefixtures("neighbours")
async def test_programs_get_in_through_a_storm(daemon: Daemon) -> None:
    """Their neighbours, by socket, lose nothing; the log stays readable."""
    with storms(daemon, 2):
        await until(lambda: "turned away" in daemon.log.read_text())
        for at in range(10):
            async with bus.Node(f"late{at}", arguments=[], rosout=False) as node:
                await node.create_publisher(bus.msg.std_msgs.String, "t")
        await until(lambda: "more of user" in daemon.log.read_text())
    lines = daemon.log.read_text().splitlines()
    assert len([line for line in lines if "turned away" in line]) < 10 + 2 * WAIT_S


def test_silent_ones_take_no_place_inside_and_little_memory(daemon: Daemon) -> None:
    with contextlib.ExitStack() as stack:
        peer = stack.enter_context(RawPeer(daemon.path)).hello()
        before = resident_bytes(daemon.pid)
        silent = [stack.enter_context(RawPeer(daemon.path)) for _ in range(MOST_WAITING + 40)]
        for guest in silent[:40]:
            assert "no place left" in guest.fault()
        answer = peer.ask(m.GetPeers(request=peer.request()))
        assert len(answer.peers) == 1
        assert answer.users[0].refused == 40
        assert resident_bytes(daemon.pid) - before < 2 * MiB
        silent[-1].hello()


class TestFullBacklog:
    async def test_a_program_waits_until_there_is_room(
        self, daemon: Daemon, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        tries = count_tries(monkeypatch, reach)
        with full_backlog(daemon):
            node = bus.Node("patient", arguments=[], rosout=False)
            opening = asyncio.ensure_future(node.open())
            await until(lambda: len(tries) > 3)
        await opening
        await node.close()

    def test_so_does_a_tool(self, daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
        tries = count_tries(monkeypatch, query)
        pauses = list[float]()

        def pause(seconds: float) -> None:
            pauses.append(seconds)
            if len(pauses) == 5:
                daemon.process.send_signal(signal.SIGCONT)

        monkeypatch.setattr(query.time, "sleep", pause)  # type: ignore[attr-defined]
        with full_backlog(daemon), Query(daemon.path, may_start=False, answer_s=WAIT_S) as asked:
            assert asked.graph().nodes == ()
        assert len(tries) > 5

    async def test_neither_waits_for_ever(self, daemon: Daemon, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(
            bus.link.reach.Patience.__init__,
            "__defaults__",
            (0.05, bus.link.reach.monotonic),  # type: ignore[attr-defined]
        )
        reason = f"busd at {daemon.path} takes no connection: too many wait to be accepted; tried for 0.05 s"
        with full_backlog(daemon):
            with pytest.raises(BrokerUnavailable, match=reason):
                await bus.Node("impatient", arguments=[]).open()
            with pytest.raises(BrokerUnavailable, match=reason):
                Query(daemon.path, answer_s=0.05)


def count_tries(monkeypatch: pytest.MonkeyPatch, module: object) -> list[None]:
    """A list that gets an item at each later attempt to connect."""
    tries, attempt = list[None](), bus.link.reach.try_to_connect

    def counted(path: object) -> object:
        tries.append(None)
        return attempt(path)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "try_to_connect", counted)
    return tries


@with_limits(connections_per_user=40)
@pytest.mark.parametrize("first_words", [b"", HELLO], ids=["silent", "hello"])
def test_who_hangs_up_keeps_no_place_and_no_memory(daemon: Daemon, first_words: bytes) -> None:
    with RawPeer(daemon.path) as peer:
        peer.hello()
        before = resident_bytes(daemon.pid)
        for _ in range(500):
            with RawPeer(daemon.path) as guest:
                guest.write(first_words)
        with RawPeer(daemon.path) as late:
            late.hello()  # waits, and is not refused
        answer = peer.ask(m.GetPeers(request=peer.request()))
        assert isinstance(answer, m.Peers)
        assert len(answer.peers) <= 2
        assert resident_bytes(daemon.pid) - before < 16 * MiB
    assert "connections of user" not in daemon.log.read_text()


@with_limits(connections_per_user=4)
def test_who_waits_does_not_hold_up_the_end(daemon: Daemon) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(6):
            with RawPeer(daemon.path) as guest:
                guest.hello()
        for _ in range(2):
            stack.enter_context(RawPeer(daemon.path)).write(HELLO)
        daemon.process.send_signal(signal.SIGTERM)
        assert daemon.process.wait(WAIT_S) == 0
