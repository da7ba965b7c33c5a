"""bus.transport.stream: the end of a connection."""

import asyncio
import gc
import socket
import weakref
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from bus.transport.stream import Handlers, Stream
from bus.transport.stream_state import WriteState
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.outbox import Outbox
from bus.wire.session import Role, Session
from conftest import WAIT_S

pytestmark = pytest.mark.both_loops

MOST_ROOM = int(Path("/proc/sys/net/core/wmem_max").read_text())
HELLO = m.encode_frame(m.Hello(version=PROTOCOL_VERSION))


class End:
    """One end of a connection. It records the received items and the reason of the end."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        self.items: list[object] = []
        self.lost: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()
        handlers = Handlers(on_received=self.items.extend, on_lost=self.lost.set_result)
        self.stream = Stream(sock, Session(Role.BROKER), Outbox(), handlers)

    async def ended(self) -> None:
        async with asyncio.timeout(WAIT_S):
            await self.lost


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    mine, other = socket.socketpair()
    with mine, other:
        yield mine, other


async def test_closed_with_something_unread(pair: tuple[socket.socket, socket.socket]) -> None:
    """The other side receives the last frames and sees the end. libuv alone may not report it."""
    mine, other = pair
    end, leaver = End(mine), End(other)
    mine.send(HELLO)
    other.send(HELLO)
    leaver.stream.close()
    await end.ended()
    assert len(end.items) == 1


async def test_killed_with_something_unread(pair: tuple[socket.socket, socket.socket]) -> None:
    """A killed process does not tidy up. The stream notices that at the next thing sent to it."""
    mine, other = pair
    end = End(mine)
    mine.send(HELLO)
    other.send(HELLO)
    other.close()
    while not end.items:  # noqa: ASYNC110
        await asyncio.sleep(0)
    if not end.lost.done():
        end.stream.outbox.put(HELLO)
        end.stream.flush()
    await end.ended()
    assert len(end.items) == 1


@pytest.mark.parametrize("is_held", [False, True])
async def test_killed_with_more_unread_than_one_read_takes(
    pair: tuple[socket.socket, socket.socket], is_held: bool
) -> None:
    """libuv reports an error only once. The stream still delivers everything, and the end, without sending a
    word.
    """
    mine, other = pair
    end = End(mine)
    for stream_end in pair:
        stream_end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    if is_held:
        end.stream.hold()
    mine.send(HELLO)
    ping = m.encode_frame(m.Ping(number=1))
    most = len(end.stream.session.reader.get_buffer()) // len(ping)
    other.send(HELLO)
    sent = other.send(ping * (most + 100)) // len(ping)
    assert sent > most
    other.close()
    if is_held:
        for _ in range(5):
            await asyncio.sleep(0)
        assert not end.items
        end.stream.release()
    await end.ended()
    assert len(end.items) == sent + 1


async def test_nothing_is_asked_of_the_socket_beside_what_has_come(
    pair: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A read costs one call."""
    mine, other = pair
    end = End(mine)
    end.stream._sock = Counted(mine)  # type: ignore[assignment]
    for number in range(3):
        other.send(HELLO if not number else m.encode_frame(m.Ping(number=number)))
        while len(end.items) <= number:  # noqa: ASYNC110
            await asyncio.sleep(0)
    assert end.stream._sock.asked == ["recv_into"] * 3  # type: ignore[attr-defined]
    end.stream.close()


@pytest.mark.parametrize("way", ["by the outbox", "past it", "lent"])
@pytest.mark.parametrize(
    ("size", "at_once", "wanted"),
    [(1_000, 1, 0), (1_000, 100, 208 << 10), (66_000, 1, 1 << 20), (1_000_000, 1, 1 << 20)],
)
async def test_who_sends_much_at_a_time_gets_more_room(
    pair: tuple[socket.socket, socket.socket], size: int, at_once: int, wanted: int, way: str
) -> None:
    """The kernel holds a bounded amount for a process that does not read, and all of it arrives.

    Long frames get more room than many short ones at once.
    """
    mine, other = pair
    end = End(mine)

    def room() -> int:
        return mine.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)

    before = room()
    sent = b""
    while end.stream.writing is not WriteState.BLOCKED:
        assert room() == before
        frame = m.encode_frame(m.Fault(text="x" * size))
        sent += frame * at_once
        if way == "by the outbox":
            for _ in range(at_once):
                end.stream.outbox.put(frame)
            end.stream.flush()
        else:
            buffer = bytearray(frame * at_once)
            assert end.stream.send_now(buffer, is_lent=way == "lent", number=at_once)
            if way == "lent":
                buffer[:] = bytes(len(buffer))  # the caller uses it again
    assert room() == max(before, 2 * min(wanted, MOST_ROOM))
    came = b""
    other.setblocking(False)
    while len(came) < len(sent):
        try:
            came += other.recv(1 << 20)
        except BlockingIOError:
            await asyncio.sleep(0)
    assert came == sent
    end.stream.close()


class Counted:
    """A socket that records calls."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self.asked: list[str] = []

    def __getattr__(self, name: str) -> object:
        if name != "fileno":
            self.asked.append(name)
        return getattr(self._sock, name)

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


async def test_held(pair: tuple[socket.socket, socket.socket]) -> None:
    """A held stream reads nothing, not even the end. After its release, it reads everything."""
    mine, other = pair
    end = End(mine)
    end.stream.hold()
    other.send(HELLO)
    other.close()
    mine.setblocking(True)
    assert mine.recv(1, socket.MSG_PEEK)  # the data has arrived
    mine.setblocking(False)
    for _ in range(3):
        await asyncio.sleep(0)
    assert not end.items
    end.stream.release()
    await end.ended()
    assert len(end.items) == 1


@pytest.mark.parametrize("who", ["we", "they"])
async def test_nobody_is_kept_by_one_that_has_ended(
    pair: tuple[socket.socket, socket.socket], who: str
) -> None:
    """Otherwise, processes that come and go would leave work to Python's collector."""
    gc.collect()
    gc.disable()
    try:
        mine, other = pair
        end = End(mine)
        end.stream._handlers = Handlers(
            on_received=partial(End.ended, end),  # type: ignore[arg-type]
            on_lost=end.lost.set_result,
            before_write=end.items.clear,
        )
        if who == "we":
            end.stream.close()
        else:
            other.close()
            await end.ended()
        kept = weakref.ref(end)
        del end
        await asyncio.sleep(0)
        assert kept() is None
    finally:
        gc.enable()


async def test_closed_while_it_is_held(pair: tuple[socket.socket, socket.socket]) -> None:
    mine, other = pair
    end = End(mine)
    end.stream.hold()
    end.stream.close()
    assert other.recv(1) == b""
    end.stream.release()  # does nothing
    await asyncio.sleep(0)
    assert not end.lost.done()
