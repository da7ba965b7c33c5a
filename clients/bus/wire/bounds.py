"""Ranges of numbers and texts in control messages, as types. The decoder refuses other values."""

from typing import Annotated

from msgspec import Meta

from bus.wire.layout import MAX_COUNT

Count = Annotated[int, Meta(ge=0, le=MAX_COUNT)]
Seq = Annotated[int, Meta(ge=1, le=MAX_COUNT)]
NextSeq = Annotated[int, Meta(ge=1, le=MAX_COUNT + 1)]
"""The number of the next sample: one above the last sample's number."""
Drops = Annotated[dict[Annotated[str, Meta(max_length=32)], Count], Meta(max_length=16)]
"""Samples dropped, by reason."""
AgeParts = Annotated[tuple[Count, ...], Meta(max_length=50)]
"""Ages in the parts of a histogram, as in `bus.base.time_parts`."""
MOST_REMEMBERED = 1024
"""Number of departed publishers whose last received number is kept."""
LastSeqs = Annotated[dict[Annotated[bytes, Meta(max_length=16)], Count], Meta(max_length=MOST_REMEMBERED)]
"""The last number received, by the gid of the publisher."""
Missed = Annotated[
    dict[Annotated[bytes, Meta(max_length=16)], tuple[Annotated[int, Meta(ge=0, le=MAX_COUNT + 1)], Count]],
    Meta(max_length=MOST_REMEMBERED),
]
"""The first number for a subscription (0: it knows that from its ring) and the last, by the gid of a
publisher."""
Descriptors = Annotated[int, Meta(ge=0, le=2)]
"""Number of file descriptors that come with the frame (docs/protocol.md)."""
Id = Annotated[int, Meta(ge=0, le=(1 << 32) - 1)]
"""The id of a node or an endpoint: data frames have 32 bits for it."""
Pid = Annotated[int, Meta(ge=0, le=(1 << 31) - 1)]
Lease = Annotated[float, Meta(ge=0, le=1e9)]
ClockOffset = Annotated[int, Meta(ge=-MAX_COUNT, le=MAX_COUNT)]
"""The difference between two monotonic clocks, in ns."""
Slot = Annotated[int, Meta(ge=0, le=65535)]
BusId = Annotated[str, Meta(min_length=1, max_length=100)]
"""The id of a bus, or the kind of a bridge."""
Buses = Annotated[tuple[BusId, ...], Meta(max_length=16)]
Gid = Annotated[bytes, Meta(max_length=16)]
"""16 bytes, or none."""
MOST_PLACES = 64
"""Most subscriptions with a place at a publisher at a time. Resent messages for all of them must not fill the
memory."""
Places = Annotated[tuple[Annotated[bytes, Meta(max_length=16)], ...], Meta(max_length=MOST_PLACES)]
"""Gids of subscriptions."""
Text = Annotated[str, Meta(max_length=1000)]
"""A text for people."""
Capabilities = Annotated[tuple[Annotated[str, Meta(max_length=64)], ...], Meta(max_length=64)]
