"""Chunks of gathered messages."""

from bus_bag.storage.bag_file import Buffer, Stamp
from bus_bag.storage.chunk import ChunkBuilder


def test_many_at_once_are_as_one_by_one() -> None:
    stamps: list[Stamp] = [
        (7, 10, 1, 0, b""),
        (8, 9, (1 << 32) + 2, 0, b""),
        (-6, 11, 3, 0, b""),
        (1 << 70, 10, 4, 0, b""),
    ]
    messages: list[Buffer] = [b"one", memoryview(b"another"), b"", b"last"]
    together, alone = ChunkBuilder(), ChunkBuilder()
    for builder in (together, alone):
        builder.add(4, 1, 1, 1, [b"before"])
    taken = together.add_many(4, stamps, messages)
    sizes = [
        alone.add(4, log_time, publish_time, sequence, [message])
        for (publish_time, log_time, sequence, _, _), message in zip(stamps, messages, strict=True)
    ]
    assert (taken, together.size) == (sum(sizes), alone.size)
    chunk, expected = together.close(), alone.close()
    assert chunk is not None
    assert expected is not None
    assert (chunk.pieces, chunk.index, chunk.crc()) == (expected.pieces, expected.index, expected.crc())
    assert (chunk.start, chunk.end, chunk.counts) == (1, 11, {4: 5})
