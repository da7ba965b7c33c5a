"""bus.transport.stream: if one side announces its end, the other half of the connection goes on."""

import asyncio
import socket
from collections.abc import Iterator

import pytest

from bus.transport.stream import Handlers, Stream
from bus.transport.stream_state import ReadState, WriteState
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.outbox import Outbox
from bus.wire.session import Role, Session
from semantics import until

pytestmark = pytest.mark.both_loops

HELLO = m.encode_frame(m.Hello(version=PROTOCOL_VERSION))
LONG = m.DeclareType(type_name="a/msg/B", type_hash="c", schema=bytes(900 << 10))


class End:
    """One end of a connection. It records the received items."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        self.items: list[object] = []
        self.losses: list[Exception | None] = []
        handlers = Handlers(on_received=self.items.extend, on_lost=self.losses.append)
        self.stream = Stream(sock, Session(Role.BROKER), Outbox(), handlers)

    def say(self, frame: bytes) -> None:
        self.stream.outbox.put(frame)
        self.stream.flush()


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    mine, other = socket.socketpair()
    with mine, other:
        yield mine, other


async def test_what_has_begun_is_ended_and_nothing_follows(pair: tuple[socket.socket, socket.socket]) -> None:
    speaker, reader = map(End, pair)
    reader.stream.hold()  # so the long frame does not leave at once
    asyncio.get_running_loop().call_later(0, reader.stream.release)
    speaker.say(HELLO + m.encode_frame(LONG))
    assert speaker.stream.writing is WriteState.BLOCKED
    speaker.stream.finish()
    speaker.say(HELLO)
    assert not speaker.stream.is_idle
    reader.stream.linger()
    await until(lambda: reader.stream.reading is ReadState.ENDED)
    assert reader.items[1:] == [LONG]
    reader.say(HELLO)  # the other half still works
    await until(lambda: speaker.items)
    assert (speaker.losses, reader.losses) == ([], [])
    assert reader.stream.is_drained
    reader.stream.close()
    await until(lambda: speaker.losses)
    speaker.stream.close()


async def test_where_nothing_has_begun(pair: tuple[socket.socket, socket.socket]) -> None:
    speaker, reader = map(End, pair)
    reader.stream.linger()
    speaker.stream.finish()
    speaker.stream.finish()
    await until(lambda: reader.stream.reading is ReadState.ENDED)
    assert (reader.items, reader.losses) == ([], [])
    speaker.stream.close()
    reader.stream.close()


async def test_one_that_does_not_linger_is_lost(pair: tuple[socket.socket, socket.socket]) -> None:
    speaker, reader = map(End, pair)
    speaker.stream.finish()
    await until(lambda: reader.losses)
    assert reader.losses == [None]
    speaker.stream.close()


async def test_what_has_come_is_heard_out(pair: tuple[socket.socket, socket.socket]) -> None:
    """The stream delivers received data, even if it is paused. Data that arrives too late is not reported as
    a second loss.
    """
    speaker, reader = map(End, pair)
    reader.stream.hold()
    reader.stream.linger()
    speaker.say(HELLO)
    for _ in range(2):
        reader.stream.drain_input()
    speaker.say(HELLO)
    await until(lambda: reader.stream.reading is ReadState.ENDED)
    assert len(reader.items) == 1
    assert reader.losses == []
    reader.stream.close()
    speaker.stream.close()


async def test_one_that_is_gone_is_drained(pair: tuple[socket.socket, socket.socket]) -> None:
    mine, other = pair
    end = End(mine)
    end.stream.linger()
    other.close()
    end.say(m.encode_frame(LONG))
    await until(lambda: end.stream.reading is ReadState.ENDED)
    assert end.stream.is_drained
    end.stream.close()


async def test_one_that_does_not_read_is_not(pair: tuple[socket.socket, socket.socket]) -> None:
    mine, _ = pair
    end = End(mine)
    end.say(m.encode_frame(LONG))
    assert not end.stream.is_drained
    end.stream.close()
    assert end.stream.is_drained
    await asyncio.sleep(0)
