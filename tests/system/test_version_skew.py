"""An older and a newer program with this busd, and this library with an older and a newer busd.

The old bytes are those of a conversation that was recorded with the first busd of protocol version 1
(tests/golden/conversation_v1.txt).
"""

import asyncio
import logging
import struct
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

import bus
import bus.link.connecting
from bus.base.version import RELEASE
from bus.wire import messages as m
from bus.wire.layout import CONTROL, FRAME_HEAD_BYTES, LEAVING, PROTOCOL_VERSION
from conftest import WAIT_S, Daemon
from fake_broker import FakeBroker
from neighbours import with_limits
from raw_peer import RawPeer, control
from semantics import until

CONVERSATION = Path(__file__).parents[1] / "golden" / "conversation_v1.txt"
OF_THE_MOMENT = ("pid", "at_ns")
"""Fields with a different value in each run."""

OLDER_BUSD = "the busd that runs is older: update it, then bus daemon stop"
OLDER_PROGRAM = "the program has an older busd than runs: update the one that it imports"


def spoken() -> Iterator[tuple[str, bytes]]:
    """Each recorded frame: `>` if the client sent it, `<` if busd did."""
    for line in CONVERSATION.read_text().splitlines():
        if not line.startswith("#"):
            yield line[0], bytes.fromhex(line[2:])


def read_frame(peer: RawPeer) -> bytes:
    """The next frame as raw bytes: no current code parses it."""
    head = _read(peer, 4)
    return head + _read(peer, struct.unpack("<I", head)[0])


def _read(peer: RawPeer, size: int) -> bytes:
    found = b""
    while len(found) < size:
        more = peer.socket.recv(size - len(found))
        assert more, "busd closed the connection"
        found += more
    return found


def meaning(frame: bytes) -> Any:
    """A control message as a map; a data frame as its bytes."""
    is_control = frame[4] == CONTROL
    return msgspec.msgpack.decode(frame[FRAME_HEAD_BYTES:]) if is_control else frame


def says_at_least(now: Any, then: Any) -> bool:
    """Whether the new message has all content of the old one; it may have more, unknown to old programs."""
    if isinstance(then, dict):
        return isinstance(now, dict) and all(
            key in now and (key in OF_THE_MOMENT or says_at_least(now[key], value))
            for key, value in then.items()
        )
    if isinstance(then, list):
        return isinstance(now, list) and len(now) == len(then) and all(map(says_at_least, now, then))
    return bool(now == then)


class TestThisBusd:
    def test_serves_an_old_client(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as old:
            for direction, frame in spoken():
                if direction == ">":
                    old.write(frame)
                else:
                    now, then = meaning(read_frame(old)), meaning(frame)
                    assert says_at_least(now, then), f"{now} where once was {then}"
        assert daemon.process.wait(WAIT_S) == 0  # the last request was to stop

    def test_says_nothing_that_an_old_client_does_not_know(self, daemon: Daemon) -> None:
        with RawPeer(daemon.path) as old:
            old.write(next(frame for _, frame in spoken()))
            assert meaning(read_frame(old))["m"] == "hello"
            daemon.process.terminate()
            assert old.socket.recv(1) == b""

    def test_serves_a_newer_client_of_its_version(self, daemon: Daemon) -> None:
        hello = {
            "m": "hello",
            "version": PROTOCOL_VERSION,
            "capabilities": ["teleport", LEAVING, "shm3"],
            "release": "99.1",
            "mood": {"good": True},
        }
        with RawPeer(daemon.path) as newer:
            newer.write(control(msgspec.msgpack.encode(hello)))
            assert newer.expect(m.Hello).release == RELEASE
            assert isinstance(newer.publisher(newer.node(), "/t"), m.Created)

    @pytest.mark.parametrize(
        ("version", "remedy"), [(0, OLDER_PROGRAM), (PROTOCOL_VERSION + 1, OLDER_BUSD), (99, OLDER_BUSD)]
    )
    def test_refuses_another_version(self, daemon: Daemon, version: int, remedy: str) -> None:
        with RawPeer(daemon.path) as other:
            other.send(m.Hello(version=version, program="other"))
            said = other.fault()
        assert said == f"protocol version {version} offered, this side speaks {PROTOCOL_VERSION}; {remedy}"


@pytest.fixture
async def broker(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[FakeBroker]:
    monkeypatch.setattr(bus.link.connecting, "_RETRY_S", (0.0, 0.01))
    async with asyncio.timeout(WAIT_S), FakeBroker(socket_path) as broker:
        yield broker


class TestThisLibrary:
    async def test_understands_an_old_busd(self, broker: FakeBroker) -> None:
        """Its recorded Hello."""
        node = bus.Node("new", arguments=[], rosout=False)
        opening = asyncio.ensure_future(node.open())
        client = await broker.meet()
        await client.expect(m.Hello)
        client.write(next(frame for direction, frame in spoken() if direction == "<"))
        await client.create(m.CreateNode, 1)
        await opening
        await node.close()

    @pytest.mark.parametrize(("version", "remedy"), [(0, OLDER_BUSD), (PROTOCOL_VERSION + 1, OLDER_PROGRAM)])
    async def test_refuses_a_busd_of_another_version(
        self, broker: FakeBroker, version: int, remedy: str
    ) -> None:
        """At once, and with the reason: another attempt would not help."""
        opening = asyncio.ensure_future(bus.Node("new", arguments=[], rosout=False).open())
        client = await broker.meet()
        await client.expect(m.Hello)
        client.send(m.Hello(version=version, program="busd"))
        with pytest.raises(bus.BrokerUnavailable) as caught:
            await opening
        text = f"protocol version {version} offered, this side speaks {PROTOCOL_VERSION}; {remedy}"
        assert str(caught.value).endswith(text)
        assert broker.connections == 1

    async def test_says_once_what_came_back(
        self, broker: FakeBroker, caplog: pytest.LogCaptureFixture
    ) -> None:
        """An open node keeps trying, because busd may be replaced; its log is not flooded."""
        caplog.set_level(logging.WARNING, "bus")
        node = bus.Node("new", arguments=[], rosout=False)
        opening = asyncio.ensure_future(node.open())
        client = await broker.accept()
        await client.create(m.CreateNode, 1)
        await opening
        await client.close()
        for _ in range(3):
            newer = await broker.meet()
            await newer.expect(m.Hello)
            newer.send(m.Hello(version=PROTOCOL_VERSION + 1, program="busd"))
        right = await broker.accept()
        await right.create(m.CreateNode, 2)
        await until(lambda: node._declared.id == 2)
        await node.close()
        said = [record.getMessage() for record in caplog.records]
        assert len([line for line in said if OLDER_PROGRAM in line]) == 1


@with_limits(drain_s=0.1)
async def test_a_node_leaves_in_order_with_a_busd_that_ends(daemon: Daemon) -> None:
    """The node announces that it understands Leaving, and acts on it."""
    async with bus.Node("new", arguments=[], rosout=False) as node:
        await node.graph()
        daemon.process.terminate()
        await until(lambda: not node._declared.id)
    daemon.process.wait(WAIT_S)
    assert "does not read" not in daemon.log.read_text()
