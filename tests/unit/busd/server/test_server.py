"""busd.server.server: the steps of its end, and its care for connections that come and go."""

import asyncio
import os
import socket
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from bus.wire.layout import LEAVING, PROTOCOL_VERSION
from bus.wire.messages import Hello, Matched, Ping, Pong
from busd.core.broker import Broker
from busd.core.limits import Limits
from busd.server.credentials import Credentials
from busd.server.listener import Listener, open_listener
from busd.server.server import Server
from callcount import CallCounter
from conftest import WAIT_S
from raw_peer import RawPeer

pytestmark = pytest.mark.both_loops


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[Listener]:
    with open_listener(tmp_path / "busd.sock") as listener:
        yield listener


async def test_it_stops_listening_first(listener: Listener) -> None:
    """A client of a busd that ends must find no socket, rather than a server that says nothing."""
    server = Server(listener, Broker())
    server.stop("a test")
    assert not listener.path.exists()
    with socket.socket(socket.AF_UNIX) as late, pytest.raises(FileNotFoundError):
        late.connect(str(listener.path))
    with open_listener(listener.path):
        pass  # the next busd need not wait for the process to end
    assert await server.stopped == "a test"


async def test_only_one_with_an_idle_exit_is_in_the_background(listener: Listener) -> None:
    server = Server(listener, Broker(), idle_s=30)
    assert server.is_background
    server.stop("a test")


async def test_it_is_not_idle_while_somebody_waits_in_its_backlog(listener: Listener) -> None:
    server = Server(listener, Broker(), idle_s=30)
    with socket.socket(socket.AF_UNIX) as early:
        early.connect(str(listener.path))
        server._end_idleness(30)  # the timer was due before the loop looked at its sockets
        assert not server.stopped.done()
        assert server._idle_timer is not None
    server.stop("a test")
    await server.stopped


async def test_one_that_nobody_has_come_to_is_idle(listener: Listener) -> None:
    server = Server(listener, Broker(), idle_s=0.01)
    assert await server.stopped == "idle for 0.01 s"


async def test_processes_without_a_pid_have_turns_of_their_own(listener: Listener) -> None:
    """In another pid namespace, all processes have the pid 0. The connections of one process share its
    turns.
    """
    server, ends = Server(listener, Broker()), []
    for key in (("pidfs", 1), ("pidfs", 1), ("pidfs", 2), ("connection", 1)):
        here, there = socket.socketpair()
        here.setblocking(False)
        ends.append(there)
        server.let_in(here, Credentials(0, 1000, 1000, process=key), Hello(version=PROTOCOL_VERSION))
    first, again, second, third = (one.party for one in sorted(server._connections, key=lambda one: one.id))
    assert first is again
    assert len({first, second, third}) == 3
    for end in ends:
        end.close()
    server.stop("a test")
    await server.stopped


async def test_calls_of_a_subscription_from_socket_to_socket(listener: Listener) -> None:
    """All calls of busd for a subscription that matches a publisher by socket. See `callcount`."""
    server = Server(listener, Broker(uid=os.getuid()))
    counts = list[int]()
    with RawPeer(listener.path) as talker, RawPeer(listener.path) as peer:
        for one in (talker, peer):
            await asyncio.to_thread(one.hello)
        from_node = await asyncio.to_thread(talker.node)
        node = await asyncio.to_thread(peer.node, "listener")
        for topic in ("/a", "/b", "/c"):
            await asyncio.to_thread(talker.publisher, from_node, topic)
            with CallCounter() as counter:
                await asyncio.to_thread(peer.subscription, node, topic)
            await asyncio.to_thread(talker.expect, Matched)
            counts.append(counter.python)
    server.stop("a test")
    await server.stopped
    assert 40 <= min(counts) <= 94


@pytest.fixture
async def server(listener: Listener) -> AsyncIterator[Server]:
    """A server with a peer that goes on sending, so its end is not over before the peer is closed."""
    server = Server(listener, Broker(Limits(drain_s=3600), uid=os.getuid()))
    with RawPeer(listener.path) as peer:
        polite = Hello(version=PROTOCOL_VERSION, capabilities=(LEAVING,), program="polite peer")
        peer.send(polite)
        await asyncio.to_thread(peer.expect, Hello)
        yield server
    async with asyncio.timeout(WAIT_S):
        await server.stopped


class TestEnd:
    async def test_on_a_restart_the_next_busd_gets_the_socket(
        self, server: Server, listener: Listener
    ) -> None:
        server.restart("one")
        assert server.is_ending and server.is_restarting
        assert listener.path.exists()
        with socket.socket(socket.AF_UNIX) as early:
            early.connect(str(listener.path))  # waits for the next busd

    @pytest.mark.parametrize("way", ["stop", "stop_now"])
    async def test_a_restart_can_be_turned_into_an_end(
        self, way: str, server: Server, listener: Listener
    ) -> None:
        """A program that then starts a busd need not wait for this one."""
        server.restart("one")
        getattr(server, way)("two")
        assert not server.is_restarting
        assert not listener.path.exists()
        assert not server.stopped.done()

    @pytest.mark.parametrize("way", ["stop", "stop_now"])
    async def test_also_when_the_last_connection_is_closed(self, way: str, listener: Listener) -> None:
        server = Server(listener, Broker())
        server.restart("one")
        assert server.stopped.result() == "one"
        assert server.is_restarting and listener.path.exists()
        getattr(server, way)("two")
        assert not server.is_restarting
        assert not listener.path.exists()

    async def test_an_end_is_never_a_restart(self, server: Server, listener: Listener) -> None:
        server.stop("one")
        server.restart("two")
        assert not server.is_restarting
        assert not listener.path.exists()

    @pytest.mark.parametrize("first", ["stop", "stop_now", "restart"])
    async def test_the_second_signal_waits_for_nobody(self, first: str, server: Server) -> None:
        """If a restart has begun, the first signal turns it into an end."""
        getattr(server, first)("one")
        server.stop("two")
        assert not server.stopped.done()
        server.stop_now("three")
        assert server.stopped.result() == "one"

    async def test_who_is_paused_is_heard_out(self, listener: Listener) -> None:
        """A pause may be longer than the end."""
        server = Server(listener, Broker(Limits(drain_s=3600), uid=os.getuid()))
        with RawPeer(listener.path) as peer:
            await asyncio.to_thread(peer.hello)
            (connection,) = server._connections
            connection.pause(3600)
            peer.send(Ping(number=7))
            server.stop("a test")
            assert not connection.is_held
            assert (await asyncio.to_thread(peer.expect, Pong)).number == 7
            async with asyncio.timeout(WAIT_S):
                await server.stopped

    async def test_nothing_is_due_any_more(self, server: Server) -> None:
        """For example, no lease ends: busd soon stops reading."""
        due = list[int]()
        server._broker.timers.add(0, due.append)
        server._alarm.set()
        server.stop("a test")
        server._broker.timers.add(0, due.append)
        server._alarm.set()
        await asyncio.sleep(0.01)
        assert due == []
