"""bus.transport.stream: descriptors beside the bytes, over real sockets."""

import asyncio
import gc
import os
import socket
from collections.abc import Callable, Iterator

import pytest

from bus.base.descriptor import Descriptor
from bus.errors import RemoteProtocolError
from bus.transport.stream import Handlers, Stream, trusting
from bus.transport.stream_state import WriteState
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.outbox import Outbox
from bus.wire.runs import Account, Run, RunQueue
from bus.wire.session import MAX_BATCHES, Carried, Role, Session
from conftest import WAIT_S, open_descriptors
from feeding import frame_record

pytestmark = pytest.mark.both_loops

HELLO = m.encode_frame(m.Hello(version=PROTOCOL_VERSION))
PING = m.encode_frame(m.Ping())
SHARE = m.encode_frame(m.Share())

Pair = tuple[socket.socket, socket.socket]


class End:
    """One end of a connection. It records the received items and the reason of the end."""

    def __init__(self, sock: socket.socket, *, takes_descriptors: bool = True) -> None:
        sock.setblocking(False)
        self.items: list[object] = []
        self.lost: asyncio.Future[Exception | None] = asyncio.get_running_loop().create_future()
        handlers = Handlers(on_received=self.items.extend, on_lost=self.lost.set_result)
        taker = trusting if takes_descriptors else None
        self.stream = Stream(sock, Session(Role.BROKER), Outbox(), handlers, taker)

    def say(self, frame: bytes, *descriptors: Descriptor) -> None:
        self.stream.outbox.put(frame, descriptors)
        self.stream.flush()


@pytest.fixture
def pair() -> Iterator[Pair]:
    mine, other = socket.socketpair()
    with mine, other:
        for sock in (mine, other):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)  # the kernel's minimum is a few KiB
        mine.send(HELLO)
        other.send(HELLO)
        yield mine, other


@pytest.fixture(autouse=True)
def by_counting_references() -> Iterator[None]:
    """Descriptors are closed when the last reference goes, not when the collector runs."""
    gc.disable()
    yield
    gc.enable()


async def until(condition: Callable[[], object]) -> None:
    async with asyncio.timeout(WAIT_S):
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0)


def numbered(number: int) -> Descriptor:
    return Descriptor(os.eventfd(number, os.EFD_NONBLOCK))


def send(sock: socket.socket, frame: bytes, *descriptors: Descriptor) -> None:
    socket.send_fds(sock, [frame], [one.fileno() for one in descriptors])


def opened() -> int:
    """The number of open descriptors, except those of epoll: the event loop's, and the one for its
    streams.
    """
    return sum(one != "anon_inode:[eventpoll]" for one in open_descriptors().values())


def values(carried: object) -> tuple[int, ...]:
    """The numbers in the received descriptors. They can be read only once."""
    assert isinstance(carried, Carried)
    assert not any(os.get_inheritable(one.fileno()) for one in carried.descriptors)
    return tuple(os.eventfd_read(one.fileno()) for one in carried.descriptors)


def ring(number: int, filling: int = 0) -> bytes:
    """A frame that carries one descriptor."""
    return m.encode_frame(
        m.CreatePublisher(
            request=number,
            node=1,
            topic="x" * filling,
            type_name="",
            type_hash="",
            qos=m.QoSProfile(),  # type: ignore[attr-defined]
            gid=b"",
            descriptors=1,
        )
    )


async def test_both_ways_at_once_among_other_traffic(pair: Pair) -> None:
    before = opened()
    ends = [End(sock) for sock in pair]
    for end in ends:
        queue = RunQueue(0, Account(1 << 30), endpoint=7)
        for number in range(1, 201):
            queue.append(Run(0, 0, number, 1, frame_record(bytes(number * 37 % 3000), 5)))
            if number % 3 == 0:
                end.stream.outbox.put(m.encode_frame(m.Ping(number=number)))
            if number % 5 == 0:
                end.say(ring(number, number * 101 % 9000), numbered(number))
            if number % 7 == 0:
                end.say(SHARE, numbered(number), numbered(2 * number))
            if number % 11 == 0:
                end.stream.outbox.make_ready(queue)
                await asyncio.sleep(0)
        end.stream.outbox.make_ready(queue)
        end.stream.flush()
    for end in ends:
        await until(lambda end=end: len([one for one in end.items if isinstance(one, Run)]) == 200)
        assert [one.first_seq for one in end.items if isinstance(one, Run)] == [*range(1, 201)]
        assert [one.number for one in end.items if isinstance(one, m.Ping)] == [*range(3, 201, 3)]
        carried = [one for one in end.items if isinstance(one, Carried)]
        rings = [one for one in carried if isinstance(one.message, m.CreatePublisher)]
        assert [one.message.request for one in rings] == [*range(5, 201, 5)]  # type: ignore[attr-defined]
        assert [values(one) for one in rings] == [(number,) for number in range(5, 201, 5)]
        shared = [one for one in carried if isinstance(one.message, m.Share)]
        assert [values(one) for one in shared] == [(number, 2 * number) for number in range(7, 201, 7)]
        end.items.clear()
    del carried, rings, shared
    assert opened() == before
    for end in ends:
        end.stream.close()


async def test_descriptors_go_with_the_first_byte(pair: Pair) -> None:
    mine, other = pair
    before = opened()
    sender = End(mine)
    sender.say(ring(1, 100_000), numbered(41))
    assert sender.stream.writing is WriteState.BLOCKED, "the frame is longer than what the socket takes"
    assert opened() == before, "on their way, and not held any more"
    sender.say(ring(2, 100_000), numbered(42))
    assert opened() == before + 1
    receiver = End(other)
    await until(lambda: len(receiver.items) == 3)
    assert [values(one) for one in receiver.items[1:]] == [(41,), (42,)]
    receiver.items.clear()
    assert opened() == before
    sender.stream.close()
    receiver.stream.close()


async def test_descriptors_wait_where_no_byte_could_leave(pair: Pair) -> None:
    mine, other = pair
    before = opened()
    sender = End(mine)
    while sender.stream.writing is not WriteState.BLOCKED:
        sender.say(PING)
    for number in (41, 42):
        sender.say(ring(number), numbered(number))
    sender.say(PING)
    assert opened() == before + 2
    receiver = End(other)
    await until(lambda: sum(isinstance(one, Carried) for one in receiver.items) == 2)
    await until(lambda: receiver.items[-1] == m.Ping())
    *pings, first, second, _ = receiver.items[1:]
    assert all(one == m.Ping() for one in pings)
    assert (values(first), values(second)) == ((41,), (42,))
    sender.stream.close()
    receiver.stream.close()


async def test_others_may_hold_what_is_sent(pair: Pair) -> None:
    mine, other = pair
    sender, receiver, held = End(mine), End(other), numbered(1)
    sender.say(ring(1), held)
    await until(lambda: len(receiver.items) == 2)
    os.eventfd_write(held.fileno(), 4)
    assert values(receiver.items[1]) == (5,)
    sender.stream.close()
    receiver.stream.close()


async def test_who_takes_none_gets_none(pair: Pair) -> None:
    mine, other = pair
    receiver = End(other, takes_descriptors=False)
    before = opened()
    send(mine, SHARE, numbered(1), numbered(2))
    await until(lambda: len(receiver.items) == 2)
    assert receiver.items[1:] == [Carried(m.Share(), ())]
    assert opened() == before
    receiver.stream.close()


async def test_more_than_a_message_may_carry(pair: Pair) -> None:
    """The kernel delivers the first two descriptors, and the stream keeps neither. The next message is
    complete again.
    """
    mine, other = pair
    receiver = End(other)
    before = opened()
    send(mine, SHARE, numbered(1), numbered(2), numbered(3))
    send(mine, SHARE, numbered(4), numbered(5))
    await until(lambda: len(receiver.items) == 3)
    assert receiver.items[1] == Carried(m.Share(), ())
    assert values(receiver.items.pop()) == (4, 5)
    assert opened() == before
    receiver.stream.close()


async def test_a_flood_that_no_message_claims(pair: Pair) -> None:
    mine, other = pair
    mine.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    receiver = End(other)
    before = opened()
    for _ in range(MAX_BATCHES + 1):
        send(mine, PING, numbered(1), numbered(2))
    async with asyncio.timeout(WAIT_S):
        error = await receiver.lost
    assert isinstance(error, RemoteProtocolError)
    assert str(error) == "descriptors that no message claims"
    assert opened() == before - 1, "the socket, too, is closed"


@pytest.mark.parametrize("end", ["closed", "closed by the peer", "abandoned"])
async def test_an_end_with_half_a_message(pair: Pair, end: str) -> None:
    mine, other = pair
    receiver = End(other)
    before = opened()
    send(mine, SHARE[:5], numbered(1), numbered(2))
    await until(lambda: receiver.stream.session.descriptors)
    assert opened() == before + 2
    match end:
        case "closed":
            receiver.stream.close()
        case "closed by the peer":
            mine.close()
            async with asyncio.timeout(WAIT_S):
                await receiver.lost
            before -= 1
        case "abandoned":
            asyncio.get_running_loop().remove_reader(other.fileno())
            receiver.stream.abandon()
    assert opened() == before - 1


@pytest.mark.parametrize("wait", ["in the outbox", "in the stream"])
async def test_an_end_with_descriptors_unsent(pair: Pair, wait: str) -> None:
    mine, _ = pair
    before = opened()
    sender = End(mine)
    while sender.stream.writing is not WriteState.BLOCKED:
        if wait == "in the stream":
            sender.say(SHARE, numbered(1), numbered(2))
        else:
            sender.say(PING)
    if wait == "in the outbox":
        sender.say(SHARE, numbered(1), numbered(2))
    assert opened() > before
    sender.stream.close()
    assert opened() == before - 1
