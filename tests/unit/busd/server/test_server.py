"""busd.server.server: the order in which it ends, and what it does for connections that come and go."""

import asyncio
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.base.ids import PeerId
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.messages import Hello, Matched
from bus.wire.runs import Run
from busd.core.broker import Broker
from busd.core.turns import Party
from busd.server.credentials import Credentials
from busd.server.listener import Listener, open_listener
from busd.server.peer import PeerConnection
from busd.server.server import Server
from callcount import CallCounter
from raw_peer import RawPeer
from semantics import until


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[Listener]:
    with open_listener(tmp_path / "busd.sock") as listener:
        yield listener


async def test_it_stops_listening_first(listener: Listener) -> None:
    """Who connects to a busd that ends must find none, rather than one that says nothing."""
    server = Server(listener, Broker())
    server.stop("a test")
    assert not listener.path.exists()
    with socket.socket(socket.AF_UNIX) as late, pytest.raises(FileNotFoundError):
        late.connect(str(listener.path))
    with open_listener(listener.path):
        pass  # the next one need not wait for the process to end
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
    """In another pid namespace all have the pid 0; the connections of one process share its turns."""
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


class Deaf:
    """Stands for a connection; says when it is flushed."""

    id = PeerId(1)
    is_closed = is_choked = is_held = False
    items = None

    def __init__(self, flushed: list["Deaf"]) -> None:
        self.stream = self
        self.party: Party[PeerConnection | PeerId] = Party()
        self._flushed = flushed

    def flush(self) -> int:
        self._flushed.append(self)
        return 1


async def test_who_asked_is_answered_after_the_others_were_told(listener: Listener) -> None:
    """A subscription that was made may count on every publisher having been told of it."""
    server = Server(listener, Broker())
    flushed: list[Deaf] = []
    connections = [Deaf(flushed) for _ in range(20)]
    for asker in connections:
        server._effects.dirty.update(connections)  # type: ignore[arg-type]
        server._effects.flush(asker)  # type: ignore[arg-type]
        assert len(flushed) == len(connections)
        assert flushed[-1] is asker
        flushed.clear()
    server._effects.flush(connections[0])  # type: ignore[arg-type]
    assert flushed == []
    server.stop("a test")


@pytest.mark.parametrize("is_swamped", [True, False])
async def test_it_gives_way_where_more_comes_than_can_be_taken(
    is_swamped: bool, listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And only there: what is taken passes as fast as it goes."""
    broker, yields = Broker(), list[None]()
    monkeypatch.setattr("os.sched_yield", lambda: yields.append(None))

    def route(*_: object) -> list[object]:
        broker.is_overfull = is_swamped
        return []

    def trim(_: int) -> list[object]:
        broker.is_overfull = False
        return []

    monkeypatch.setattr(broker, "route", route)
    monkeypatch.setattr(broker, "trim", trim)
    server = Server(listener, broker)
    connection = Deaf([])

    server.serving._handle(connection, [Run(1, 0, 1, 1, b"")] * 10)  # type: ignore[arg-type]

    assert len(yields) == is_swamped  # once for all that one read brought
    server.stop("a test")


async def test_calls_of_a_subscription_from_socket_to_socket(listener: Listener) -> None:
    """What all of busd does for one that matches a publisher, by socket; see `callcount`."""
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


async def test_one_that_is_back_waits_without_turns_for_what_is_held_of_it(
    listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its earlier connection is paused, and what that had is in the graph until busd reads its end."""
    server = Server(listener, Broker(uid=os.getuid()))
    serve, turns = server.serving._serve, 0

    def counted() -> None:
        nonlocal turns
        turns += 1
        serve()

    monkeypatch.setattr(server.serving, "_serve", counted)
    with RawPeer(listener.path) as old, RawPeer(listener.path) as new:
        await asyncio.to_thread(old.hello)
        await asyncio.to_thread(old.node, "back")
        (connection,) = server._connections
        connection.pause(60)
        old.close()
        await asyncio.to_thread(new.hello)
        asked = asyncio.create_task(asyncio.to_thread(new.node, "back"))
        (other,) = server._connections - {connection}
        await until(lambda: other in server.serving._early)
        before = turns
        for _ in range(100):
            await asyncio.sleep(0)
        assert (turns, asked.done()) == (before, False)
        connection.end_pause()
        await asked
        assert server._connections == {other}
    server.stop("a test")
    await server.stopped
