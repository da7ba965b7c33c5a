"""Connections that wait until they are heard, because too many came lately."""

import contextlib
import signal

import pytest

from bus.wire import messages as m
from conftest import WAIT_S, Daemon
from neighbours import resident_bytes, with_limits
from raw_peer import HELLO, RawPeer

MiB = 1 << 20


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
