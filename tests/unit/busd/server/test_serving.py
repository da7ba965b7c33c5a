"""busd.server.serving: the order of reading and handling, its cost, and the wait for connections that have
left.
"""

import asyncio
import os
import socket
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from bus.base.ids import PeerId
from bus.transport.stream_state import ReadState, WriteState
from bus.wire import messages as m
from bus.wire.layout import LEAVING, PROTOCOL_VERSION
from bus.wire.runs import Run
from busd.core.broker import Broker
from busd.core.limits import Limits
from busd.core.turns import BUDGET, Party
from busd.server.listener import open_listener
from busd.server.peer import PeerConnection
from busd.server.server import Server
from conftest import WAIT_S
from raw_peer import RawPeer
from semantics import until

pytestmark = pytest.mark.both_loops

LONG_S = 3600
"""Far longer than a test may take. A test that waits for this hangs."""


@pytest.fixture
async def server(tmp_path: Path) -> AsyncIterator[Server]:
    with open_listener(tmp_path / "busd.sock") as listener:
        server = Server(listener, Broker(Limits(drain_s=LONG_S), uid=os.getuid()))
        server.path = listener.path  # type: ignore[attr-defined]
        yield server
        for _ in range(2):
            server.stop_now("a test")
        await server.stopped


def peer_of(server: Server) -> RawPeer:
    return RawPeer(server.path)  # type: ignore[attr-defined]


class Deaf:
    """Replaces a connection that is never read again."""

    id = PeerId(1)
    reading, writing = ReadState.OPEN, WriteState.OPEN
    is_choked = is_held = False
    items = None

    def __init__(self) -> None:
        self.stream = self
        self.party: Party[PeerConnection | PeerId] = Party()

    def flush(self) -> int:
        return 1


@pytest.mark.parametrize("is_swamped", [True, False])
async def test_it_gives_way_where_more_comes_than_can_be_taken(
    is_swamped: bool, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """busd gives way only in this case. Otherwise, runs pass as fast as they come."""
    broker, yields = server._broker, list[None]()
    monkeypatch.setattr("os.sched_yield", lambda: yields.append(None))

    def route(*_: object) -> list[object]:
        broker.is_overfull = is_swamped
        return []

    def trim(_: int) -> list[object]:
        broker.is_overfull = False
        return []

    monkeypatch.setattr(broker, "route", route)
    monkeypatch.setattr(broker, "trim", trim)

    server.serving._handle(Deaf(), [Run(1, 0, 1, 1, b"")] * 10)  # type: ignore[arg-type]

    assert len(yields) == is_swamped  # once for the whole read


@pytest.mark.parametrize("has_gone", [True, False])
async def test_questions_of_one_that_has_gone_are_not_answered(
    has_gone: bool, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An answer about the graph may be long. The rest of its messages also concerns others."""
    questions: list[m.Message] = [
        m.GetGraph(request=1),
        m.GetType(request=2, type_name="a", type_hash="b"),
        m.GetPeers(request=3),
        m.Observe(request=4),
    ]
    rest: list[m.Message] = [m.Ping(number=5), m.DestroyNode(node=6)]
    handled = list[m.Message]()
    monkeypatch.setattr(server._broker, "handle", lambda now_ns, peer, message: handled.append(message) or [])
    connection = Deaf()
    connection.writing = WriteState.ENDED if has_gone else WriteState.OPEN
    server.serving._handle(connection, questions + rest)  # type: ignore[arg-type]
    assert handled == (rest if has_gone else questions + rest)


class TestCost:
    async def paid(self, server: Server, peer: RawPeer, raw: bytes) -> int:
        """The cost of the read of `raw`, which must arrive at once."""
        (connection,) = server._connections
        await asyncio.sleep(0.01)
        connection.party.refill(time.monotonic_ns())
        assert connection.party.left == BUDGET
        peer.write(raw)
        connection.stream._on_readable()
        return BUDGET - connection.party.left

    async def test_of_a_read(self, server: Server) -> None:
        with peer_of(server) as peer:
            await asyncio.to_thread(peer.hello)
            frame = m.encode_frame(m.Pong(number=1))
            assert await self.paid(server, peer, frame) == 5 + 3
            assert await self.paid(server, peer, 2 * frame) == 5 + 2 * 3

    async def test_of_a_read_that_makes_no_frame_whole(self, server: Server) -> None:
        """Otherwise the same bytes could cost many reads."""
        with peer_of(server) as peer:
            await asyncio.to_thread(peer.hello)
            frame = m.encode_frame(m.DeclareType(type_name="a", type_hash="b", schema=bytes(40_000)))
            assert await self.paid(server, peer, frame[:100]) == 5 + 7
            assert await self.paid(server, peer, frame[100 : 100 + 3 * 8192]) == 5 + 7 + 3

    async def test_is_charged_to_the_one_for_whom_all_is_done(self, server: Server) -> None:
        """If a process's message ends others, it pays for that, too."""
        one, other = (server.serving._turns.party(name) for name in ("one", "other"))
        for party, payers in ((one, (one, other)), (other, (other, one))):
            before = [each.left for each in payers]
            with server.serving._metered(party), server.serving._metered(payers[1]):
                server._broker.meter.left -= 10
            assert [each.left for each in payers] == [before[0] - 10, before[1]]


class TestBack:
    """A process that connects again before its earlier connection has ended."""

    async def come_back(self, server: Server, old: RawPeer, new: RawPeer) -> asyncio.Task[Any]:
        """`old` is paused, and has hung up. `new` asks for a node and waits. Returns the waiting task."""
        await asyncio.to_thread(old.hello)
        await asyncio.to_thread(old.node, "back")
        (connection,) = server._connections
        connection.pause(60)
        old.close()
        new.send(m.Hello(version=PROTOCOL_VERSION, capabilities=(LEAVING,), program="polite peer"))
        await asyncio.to_thread(new.expect, m.Hello)
        asked = asyncio.create_task(asyncio.to_thread(new.node, "back"))
        (other,) = server._connections - {connection}
        await until(lambda: other in server.serving._early)
        return asked

    async def test_it_waits_without_turns_for_what_is_held_of_it(
        self, server: Server, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The old nodes and endpoints are in the graph until busd reads the end of the earlier connection."""
        serve, turns = server.serving._serve, 0

        def counted() -> None:
            nonlocal turns
            turns += 1
            serve()

        monkeypatch.setattr(server.serving, "_serve", counted)
        with peer_of(server) as old, peer_of(server) as new:
            asked = await self.come_back(server, old, new)
            before = turns
            for _ in range(100):
                await asyncio.sleep(0)
            assert (turns, asked.done()) == (before, False)
            min(server._connections, key=lambda one: one.id).end_pause()
            await asked
            assert len(server._connections) == 1

    async def test_it_is_heard_out_when_busd_ends(self, server: Server) -> None:
        """The earlier connection then ends, too. No connection waits for the whole time of the end."""
        with peer_of(server) as old, peer_of(server) as new:
            asked = await self.come_back(server, old, new)
            server.stop("a test")
            async with asyncio.timeout(WAIT_S):
                await asked
                new.socket.shutdown(socket.SHUT_WR)
                await server.stopped

    async def test_it_waits_until_all_that_it_had_is_removed(self, server: Server) -> None:
        """This may take several turns."""
        with peer_of(server) as old, peer_of(server) as new:
            await asyncio.to_thread(old.hello)
            node = await asyncio.to_thread(old.node, "back")
            for at in range(40):
                await asyncio.to_thread(old.publisher, node, f"/topic_{at}")
            (connection,) = server._connections
            await asyncio.to_thread(new.hello)
            (other,) = server._connections - {connection}
            new.send(m.CreateNode(request=1, name="new", namespace="/"))
            connection.party.left = 1
            server.lose(connection, "a test", is_cut=False)
            connection.close()
            assert [*server.serving._gone] == [connection.id]
            assert not server.serving.may_read(other)
            server.serving._serve_connection(other)
            assert server.serving._early == {other}
            for _ in range(100):
                await asyncio.sleep(0)
            assert not server.serving._gone and not server.serving._early
            assert (await asyncio.to_thread(new.expect, m.Created)).request == 1
            assert [one.name for one in server._broker.graph.nodes.values()] == ["new"]

    @pytest.mark.parametrize("way", ["detach", "go_on"])
    async def test_a_bug_of_the_core_does_not_make_it_wait_for_ever(
        self, way: str, server: Server, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def fail(now_ns: int, peer: PeerId) -> Any:
            raise ZeroDivisionError

        with peer_of(server) as old:
            await asyncio.to_thread(old.hello)
            (connection,) = server._connections
            monkeypatch.setattr(server._broker, way, fail)
            monkeypatch.setattr(server._broker.tasks, "has_work", lambda peer: True)
            serving = server.serving
            with pytest.raises(ZeroDivisionError):
                if way == "detach":
                    serving.remove(connection)
                else:
                    serving._gone[connection.id] = connection.party
                    serving._go_on(connection.id)
            assert serving._gone == {}
            monkeypatch.undo()


async def test_one_that_the_core_has_cut_off_is_forgotten(server: Server) -> None:
    """It sent a forbidden message, so the core itself removes its nodes and endpoints."""
    with peer_of(server) as peer:
        await asyncio.to_thread(peer.hello)
        peer.send(m.DestroyNode(node=99))
        assert "99" in await asyncio.to_thread(peer.fault)
    assert server.serving._gone == {}
    assert not server._connections and not server._peers
