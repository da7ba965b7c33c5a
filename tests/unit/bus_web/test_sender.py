"""The way from an outbox to a socket."""

import asyncio
from contextlib import suppress

import pytest

from bus_web.outbox import Outbox
from bus_web.sender import Sender
from web_world import ListSocket, turns


async def test_in_order_and_told_when_notices_are_read() -> None:
    socket = ListSocket()
    sender = Sender(socket, Outbox(100))
    await sender.drain()  # there are no notices yet
    sending = asyncio.get_running_loop().create_task(sender.run())
    socket.may_send.clear()
    sender.notify(b'{"op":1}')
    sender.put("/x", b"\x01x")
    sender.notify(b'{"op":2}')
    draining = asyncio.get_running_loop().create_task(sender.drain())
    await turns()
    assert not draining.done()
    assert sender.notices == 1, "the first is being sent"
    socket.may_send.set()
    await draining
    assert socket.sent == [b'{"op":1}', b"\x01x", b'{"op":2}']
    sender.put("/y", b"\x01y")
    sender.forget("/y")
    sender.put("/x", b"\x01z")
    await turns()
    assert socket.sent[3:] == [b"\x01z"]
    sending.cancel()
    with suppress(asyncio.CancelledError):
        await sending


@pytest.mark.parametrize(("number", "size"), [(63, 1), (1, (1 << 20) - 1)])
async def test_who_does_not_read_is_behind(number: int, size: int) -> None:
    socket = ListSocket()
    sender = Sender(socket, Outbox())
    for _ in range(number):
        sender.notify(bytes(size))
    sender.put("/x", bytes(1 << 20))
    assert not sender.is_behind, "what may be dropped does not count"
    sender.notify(b"1")
    assert sender.is_behind
    sending = asyncio.get_running_loop().create_task(sender.run())
    await sender.drain()
    assert (sender.is_behind, sender.notice_bytes) == (False, 0)
    sending.cancel()
    with suppress(asyncio.CancelledError):
        await sending


async def test_what_a_slow_client_misses_is_told_once() -> None:
    sender = Sender(ListSocket(), Outbox(10))
    for number in range(4):
        sender.put("/x", bytes([number]) * 5)
    assert sender.take_dropped() == {"/x": 2}
    assert sender.take_dropped() == {}


async def test_the_end_of_the_socket_ends_it() -> None:
    class Ended(ListSocket):
        async def send(self, message: bytes, *, text: bool) -> None:
            raise ConnectionResetError

    sender = Sender(Ended(), Outbox())
    sender.put("/x", b"x")
    with pytest.raises(ConnectionResetError):
        await sender.run()
