"""Packed messages for tests: as `Subscription.take_packed` returns them."""

from collections.abc import Iterable, Sequence
from struct import Struct

from bus.subscription import MessageInfo, Pack

__all__ = ["pack_of", "packed"]

_HEAD = Struct("<QqI")


def packed(messages: Iterable[tuple[int, int, bytes]]) -> bytes:
    """Messages back to back, each given by its number, publish time and payload."""
    return b"".join(_HEAD.pack(number, time, len(payload)) + payload for number, time, payload in messages)


def pack_of(samples: Sequence[tuple[bytes, MessageInfo]], *, has_more: bool = False) -> Pack:
    """One pack of samples that were taken together."""
    payloads = [payload for payload, _ in samples]
    data = packed((info[2], info[0], payload) for payload, info in samples)
    (gid,) = gids if len(gids := {info[4] for _, info in samples}) == 1 else (b"",)
    numbers = [info[2] for _, info in samples]
    return Pack(
        gid,
        data,
        len(samples),
        sum(map(len, payloads)),
        len(data) - len(payloads[-1]) - _HEAD.size,
        numbers == list(range(numbers[0], numbers[0] + len(numbers))),
        has_more,
        samples[-1][1].received_timestamp,
    )
