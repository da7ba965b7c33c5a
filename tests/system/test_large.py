"""Messages with a field of bytes, long or short: copied from any buffer, filled in place, read in place."""

import array
import asyncio
import ctypes
import gc
import threading
import tracemalloc
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

import bus
from bus.errors import LocalProtocolError
from semantics import KEEP_ALL, node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

by_shared_memory = pytest.mark.parametrize("route", ["shm"], indirect=True)

LONG = 300_000
MIB = 1 << 20


class Image(msgspec.Struct):
    """A camera's image."""

    number: int = 0
    data: bytes = b""
    width: int = 0


class Stereo(msgspec.Struct):
    """Messages inside a message."""

    left: Image
    right: Image


def pattern(number: int, size: int = LONG) -> bytes:
    return bytes((number + step) % 251 for step in range(251)) * (size // 251) + bytes(size % 251)


class TestBuffers:
    @pytest.mark.parametrize("size", [0, 1000, LONG])
    @pytest.mark.parametrize(
        "kind",
        [bytes, bytearray, memoryview, lambda raw: array.array("B", raw)],
        ids=["bytes", "bytearray", "memoryview", "array"],
    )
    async def test_whatever_holds_bytes_goes_in(
        self, node: bus.Node, kind: Callable[[bytes], Any], size: int
    ) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        publisher.publish(Image(1, kind(pattern(1, size)), 640))
        message, _ = await subscription.receive()
        assert message == Image(1, pattern(1, size), 640)
        assert type(message.data) is bytes

    @pytest.mark.parametrize("size", [100, LONG])
    async def test_numbers_are_no_bytes(self, node: bus.Node, size: int) -> None:
        publisher = await node.create_publisher(Image, "t", 10)
        with pytest.raises(bus.MessageTypeError, match=r"Expected `bytes`.*\$\.data"):
            publisher.publish(Image(1, array.array("d", [0.5] * size)))  # type: ignore[arg-type]
        with pytest.raises(bus.MessageTypeError, match=r"Expected `int`.*\$\.width"):
            publisher.publish(Image(1, bytes(size), "wide"))  # type: ignore[arg-type]

    async def test_the_buffer_may_be_used_again_at_once(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        buffer = bytearray(LONG)
        for number in range(5):
            buffer[:] = pattern(number)
            publisher.publish(Image(number, buffer))  # type: ignore[arg-type]
        for number in range(5):
            assert (await subscription.receive())[0] == Image(number, pattern(number))

    async def test_a_class_that_looks_at_its_fields_sees_only_what_was_given(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Checked, "t", 10)
        publisher = await node.create_publisher(Checked, "t", 10)
        publisher.publish(Checked(pattern(0)))
        loan = publisher.loan(Checked(pattern(1, 2)), "data", LONG)
        assert loan is not None
        with loan as buffer:
            buffer[:] = pattern(2)
        assert [(await subscription.receive())[0].data for _ in range(2)] == [pattern(0), pattern(2)]

    @by_shared_memory
    async def test_a_long_field_is_copied_once_in_and_once_out(self, node: bus.Node) -> None:
        """Into the ring, which is not Python's memory, and out of it."""
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        image = Image(1, bytes(4 * MIB))
        publisher.publish(image)  # grows the ring
        await subscription.receive()
        tracemalloc.start()
        try:
            publisher.publish(image)
            assert tracemalloc.get_traced_memory()[1] < MIB
            received, _ = await subscription.receive()
            assert 4 * MIB < tracemalloc.get_traced_memory()[1] < 5 * MIB
        finally:
            tracemalloc.stop()
        assert received == image


class Checked(msgspec.Struct):
    data: bytes

    def __post_init__(self) -> None:
        if not isinstance(self.data, bytes) or len(self.data) < 2:
            raise ValueError("no data")


class TestViews:
    @pytest.mark.parametrize("size", [0, 1000, LONG])
    async def test_are_read_only_and_like_bytes(self, node: bus.Node, size: int) -> None:
        subscription = await node.create_subscription(Image, "t", 10, views=True)
        publisher = await node.create_publisher(Image, "t", 10)
        publisher.publish(Image(1, pattern(1, size), 640))
        message, _ = await subscription.receive()
        assert isinstance(message, Image)
        assert (message.number, message.width) == (1, 640)
        assert isinstance(message.data, memoryview)
        assert message.data.readonly
        assert message.data == pattern(1, size)

    async def test_in_a_message_within_a_message(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Stereo, "t", 10, views=True)
        publisher = await node.create_publisher(Stereo, "t", 10)
        publisher.publish(Stereo(Image(1, pattern(1)), Image(2, pattern(2))))
        message, _ = await subscription.receive()
        assert isinstance(message.left.data, memoryview)
        assert isinstance(message.right.data, memoryview)
        assert (message.left.data, message.right.data) == (pattern(1), pattern(2))

    @by_shared_memory
    async def test_are_the_place_that_was_written(self, node: bus.Node) -> None:
        """No copy on either side: a later write to the place, although forbidden, is visible."""
        subscription = await node.create_subscription(Image, "t", 10, views=True)
        publisher = await node.create_publisher(Image, "t", 10)
        publisher.publish(Image(0))
        await subscription.receive()
        await node.graph()  # now the publisher knows where readers report pins
        loan = publisher.loan(Image(1), "data", LONG)
        assert loan is not None
        place = memoryview(loan.buffer)
        loan.publish()
        message, _ = await subscription.receive()
        place[:4] = b"late"
        assert message.data[:4] == b"late"

    async def test_are_valid_while_held_however_much_comes(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 1, views=True)
        publisher = await node.create_publisher(Image, "t", 1)
        publisher.publish(Image(0, pattern(0)))
        held, _ = await subscription.receive()
        data = held.data
        del held
        for number in range(1, 100):  # many laps of the ring
            publisher.publish(Image(number, pattern(number)))
            assert (await subscription.receive())[0].number == number
        assert data == pattern(0)

    async def test_any_number_may_be_held(self, node: bus.Node) -> None:
        """Seven are pinned and the others are copies; a user sees no difference."""
        subscription = await node.create_subscription(Image, "t", 10, views=True)
        publisher = await node.create_publisher(Image, "t", 10)
        held = []
        for number in range(30):
            publisher.publish(Image(number, pattern(number)))
            held.append((await subscription.receive())[0])
        for number, message in enumerate(held):
            assert (message.number, message.data) == (number, pattern(number))

    async def test_outlive_subscription_publisher_and_node(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Image, "t", 10)
        async with bus.Node("reader", arguments=[]) as reader:
            subscription = await reader.create_subscription(Image, "t", 10, views=True)
            publisher.publish(Image(1, pattern(1)))
            held, _ = await subscription.receive()
            await subscription.close()
        publisher.publish(Image(2, pattern(2)))
        await publisher.close()
        del subscription, publisher
        gc.collect()
        assert held.data == pattern(1)

    async def test_hold_nobody_back_who_keeps_all(self, node: bus.Node) -> None:
        """A view that is kept occupies its place in the ring, and the messages continue."""
        subscription = await node.create_subscription(Image, "t", KEEP_ALL, views=True)
        publisher = await node.create_publisher(Image, "t", KEEP_ALL)
        await publisher.send(Image(0, pattern(0)))
        held, _ = await subscription.receive()
        for number in range(1, 60):
            await publisher.send(Image(number, pattern(number)))
            assert (await subscription.receive())[0].number == number
        assert held.data == pattern(0)
        assert subscription.statistics().dropped == {}


class TestLoans:
    async def test_are_filled_and_published(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        for number, size in enumerate((0, 10, LONG, 4 * MIB)):
            loan = publisher.loan(Image(number, width=640), "data", size)
            assert loan is not None
            assert (len(loan.buffer), loan.buffer.readonly) == (size, False)
            loan.buffer[:] = pattern(number, size)
            assert publisher.statistics().published == number
            assert loan.publish() is True
            assert publisher.statistics().published == number + 1
            message, info = await subscription.receive()
            assert message == Image(number, pattern(number, size), 640)
            assert info.publication_sequence_number == number + 1

    async def test_publish_at_the_end_of_their_block(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        loan = publisher.loan(Image(1), "data", LONG)
        assert loan is not None
        with loan as buffer:
            buffer[:] = pattern(1)
        assert (await subscription.receive())[0] == Image(1, pattern(1))

    async def test_that_are_not_published_leave_no_trace(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        loan = publisher.loan(Image(1), "data", LONG)
        assert loan is not None
        loan.discard()
        loan.discard()
        loan = publisher.loan(Image(2), "data", LONG)
        assert loan is not None
        with pytest.raises(ZeroDivisionError), loan as buffer:
            buffer[0] = 1 // 0
        loan = publisher.loan(Image(3), "data", LONG)
        del loan
        gc.collect()
        publisher.publish(Image(4, b"short"))
        message, info = await subscription.receive()
        assert message == Image(4, b"short")
        assert info.publication_sequence_number == 1
        assert publisher.statistics().published == 1

    async def test_end_once(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Image, "t", 10)
        for end in (bus.Loan.publish, bus.Loan.discard):
            loan = publisher.loan(Image(1), "data", LONG)
            assert loan is not None
            buffer = loan.buffer
            end(loan)
            with pytest.raises(LocalProtocolError, match="has ended"):
                loan.publish()
            with pytest.raises(ValueError, match="released"):
                buffer[0] = 1
        assert publisher.statistics().published == 1

    async def test_nothing_else_can_be_published_meanwhile(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        loan = publisher.loan(Image(1), "data", 1000)
        assert loan is not None
        for act in (
            lambda: publisher.publish(Image(2)),
            lambda: publisher.publish(Image(2, pattern(2))),
            lambda: publisher.publish_encoded(b"\x90"),
            lambda: publisher.loan(Image(2), "data", 1000),
        ):
            with pytest.raises(LocalProtocolError, match="'/t' is open: publish or discard it first"):
                act()
        with loan as buffer:
            buffer[:] = pattern(1, 1000)
        publisher.publish(Image(3))
        heard = [(await subscription.receive())[0] for _ in range(2)]
        assert heard == [Image(1, pattern(1, 1000)), Image(3)]

    async def test_other_threads_wait_their_turn(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        loan = publisher.loan(Image(1), "data", 1000)
        assert loan is not None
        refused: list[Exception] = []

        def work() -> None:
            publisher.publish(Image(2))
            try:
                publisher.loan(Image(3), "data", 1000)
            except LocalProtocolError as error:
                refused.append(error)

        await asyncio.to_thread(work)
        flushing = asyncio.create_task(publisher.flush())
        await asyncio.sleep(0)
        loan.buffer[:] = pattern(1, 1000)
        loan.publish()
        await flushing
        heard = [(await subscription.receive())[0] for _ in range(2)]
        assert heard == [Image(1, pattern(1, 1000)), Image(2)]
        assert "the event loop's thread" in str(refused[0])

    async def test_an_array_that_was_made_of_one_does_no_harm(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", 10)
        publisher = await node.create_publisher(Image, "t", 10)
        loan = publisher.loan(Image(1), "data", 1000)
        assert loan is not None
        pixels = (ctypes.c_ubyte * 1000).from_buffer(loan.buffer)
        pixels[:] = list(pattern(1, 1000))
        loan.publish()
        publisher.publish(Image(2))
        heard = [(await subscription.receive())[0] for _ in range(2)]
        assert heard == [Image(1, pattern(1, 1000)), Image(2)]
        assert bytes(pixels) == pattern(1, 1000)

    async def test_mistakes(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Image, "t", 10)
        with pytest.raises(bus.MessageTypeError, match="no field of bytes called 'number'; it has data"):
            publisher.loan(Image(1), "number", 10)
        with pytest.raises(bus.MessageTypeError, match=r"Expected `int`.*\$\.width"):
            publisher.loan(Image(1, width="wide"), "data", 10)  # type: ignore[arg-type]
        with pytest.raises(bus.MessageTypeError, match="Image"):
            publisher.loan(Stereo(Image(), Image()), "data", 10)  # type: ignore[arg-type]
        with pytest.raises(bus.PayloadTooLarge):
            publisher.loan(Image(1), "data", 1 << 30)
        assert publisher.publish(Image(1)) is True  # no loan is open

    async def test_of_a_closed_publisher(self, node: bus.Node) -> None:
        publisher = await node.create_publisher(Image, "t", 10)
        loans = [publisher.loan(Image(1), "data", LONG)]
        await publisher.close()
        assert loans[0] is not None
        with pytest.raises(bus.ConnectionClosed, match="'/t' is closed"):
            loans[0].publish()
        with pytest.raises(bus.ConnectionClosed, match="'/t' is closed"):
            publisher.loan(Image(1), "data", LONG)
        assert publisher.statistics().published == 0

    async def test_there_are_none_where_those_who_keep_all_are_behind(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", KEEP_ALL)
        publisher = await node.create_publisher(Image, "t", KEEP_ALL)
        sent = 0
        while publisher.publish(Image(sent, pattern(sent))):
            sent += 1
        assert publisher.loan(Image(sent), "data", LONG) is None
        assert publisher.statistics().refused == 2
        heard = [(await subscription.receive())[0] for _ in range(sent)]
        assert heard == [Image(number, pattern(number)) for number in range(sent)]
        while (loan := publisher.loan(Image(sent), "data", LONG)) is None:
            await publisher.wait_for_room()
        with loan as buffer:
            buffer[:] = pattern(sent)
        assert (await subscription.receive())[0] == Image(sent, pattern(sent))

    async def test_count_as_a_sign_of_life(self, node: bus.Node) -> None:
        told: list[Any] = []
        qos = bus.QoSProfile(liveliness="manual_by_topic", liveliness_lease_duration=0.05)
        events = bus.SubscriptionEvents(liveliness_changed=told.append)
        subscription = await node.create_subscription(Image, "t", qos, events=events)
        publisher = await node.create_publisher(Image, "t", qos)
        for count in (1, 2):
            loan = publisher.loan(Image(1), "data", LONG)
            assert loan is not None
            loan.publish()
            await subscription.receive()
            await until(lambda: len(told) == 2 * count)  # noqa: B023
        assert [one.alive_count for one in told] == [1, 0, 1, 0]

    async def test_a_thread_that_publishes_all_the_while(self, node: bus.Node) -> None:
        subscription = await node.create_subscription(Image, "t", KEEP_ALL)
        publisher = await node.create_publisher(Image, "t", KEEP_ALL)
        thread = threading.Thread(target=lambda: [publisher.publish(Image(1000 + n)) for n in range(200)])
        thread.start()
        for number in range(50):
            while (loan := publisher.loan(Image(number), "data", 100)) is None:
                await publisher.wait_for_room()
            loan.buffer[:] = pattern(number, 100)
            await asyncio.sleep(0)
            loan.publish()
        await asyncio.to_thread(thread.join)
        heard = [(await subscription.receive())[0] for _ in range(250)]
        lent = [one for one in heard if one.number < 1000]
        assert lent == [Image(number, pattern(number, 100)) for number in range(50)]
        assert [one.number for one in heard if one.number >= 1000] == list(range(1000, 1200))
