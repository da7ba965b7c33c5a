"""Messages as bytes: what is encoded already goes out, and comes in undecoded."""

import array
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

import bus
from semantics import Wheel, node

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")

LONG = 300_000


def encoded(size: int = 5) -> bytes:
    """A Wheel of a whole number of doubles."""
    data = msgspec.msgpack.encode(Wheel("w" * size))
    missing = -len(data) % 8
    return msgspec.msgpack.encode(Wheel("w" * (size + missing)))


class TestBuffers:
    @pytest.mark.parametrize("size", [5, LONG])
    @pytest.mark.parametrize(
        "kind",
        [
            bytearray,
            lambda raw: array.array("d", raw),
            lambda raw: memoryview(raw).cast("d"),
            lambda raw: memoryview(raw).cast("d").cast("B").cast("B", shape=[2, len(raw) // 2]),
        ],
        ids=["bytearray", "array", "memoryview", "two dimensions"],
    )
    async def test_the_bytes_of_wider_items_are_counted(
        self, node: bus.Node, kind: Callable[[bytes], Any], size: int
    ) -> None:
        subscription = await node.create_subscription(Wheel, "t", 10)
        publisher = await node.create_publisher(Wheel, "t", 10)
        for _ in range(2):
            assert publisher.publish_encoded(kind(encoded(size)))
            message, _ = await subscription.receive()
            assert msgspec.msgpack.encode(message) == encoded(size)
        assert publisher.statistics().bytes == subscription.statistics().bytes == 2 * len(encoded(size))

    async def test_the_limit_is_one_of_bytes(self, start_daemon: Any, tmp_path: Any) -> None:
        config = tmp_path / "busd.toml"
        config.write_text("[limits]\nmessage_bytes = 1024\n")
        start_daemon("--config", str(config))
        async with bus.Node("tester", arguments=[]) as node:
            publisher = await node.create_publisher(Wheel, "t", 10)
            with pytest.raises(bus.PayloadTooLarge, match="1600") as told:
                publisher.publish_encoded(memoryview(bytes(1600)).cast("d"))
            assert told.value.size_bytes == 1600
            assert publisher.statistics().published == 0
