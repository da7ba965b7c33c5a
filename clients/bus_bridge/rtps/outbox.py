"""Submessages for participants, packed into datagrams. Pure."""

from collections.abc import Callable, Sequence
from typing import Final

from bus_bridge.rtps.ids import OUR_VENDOR
from bus_bridge.rtps.messages import write_destination, write_head
from bus_bridge.rtps.parameters import Address

__all__ = ["Outbox"]

_HEAD_BYTES: Final = 36
"""The head of a datagram: RTPS's own head, and the addressed participant."""


class Outbox:
    """Submessages that wait to be sent; `flush` sends them.

    `datagram_bytes`: submessages share a datagram up to this size. A longer one goes alone.
    """

    def __init__(
        self,
        prefix: bytes,
        transmit: Callable[[Address, bytes], None],
        datagram_bytes: int,
        vendor: bytes = OUR_VENDOR,
    ) -> None:
        self._head = write_head(prefix, vendor)
        self._transmit = transmit
        self._most = datagram_bytes - _HEAD_BYTES
        self._waiting: dict[tuple[Address, bytes], list[bytes]] = {}
        self._sizes: dict[tuple[Address, bytes], int] = {}

    def put(self, address: Address, prefix: bytes, parts: Sequence[bytes]) -> None:
        """Add submessages that stay together, for the participant with that prefix."""
        key = address, prefix
        size = sum(map(len, parts))
        held = self._sizes.get(key, 0)
        if held and held + size > self._most:
            self._send(key)
            held = 0
        self._waiting.setdefault(key, []).extend(parts)
        self._sizes[key] = held + size

    def put_for_all(self, address: Address, parts: Sequence[bytes]) -> None:
        """Send submessages at once, for all participants that receive them there."""
        self._transmit(address, self._head + b"".join(parts))

    def put_for_another(self, address: Address, prefix: bytes, parts: Sequence[bytes], source: bytes) -> None:
        """Send submessages at once, for the participant with that prefix, from another one than ours."""
        self._transmit(address, write_head(source) + write_destination(prefix) + b"".join(parts))

    def flush(self) -> None:
        """Send everything."""
        for key in list(self._waiting):
            self._send(key)

    def _send(self, key: tuple[Address, bytes]) -> None:
        address, prefix = key
        parts = self._waiting.pop(key)
        del self._sizes[key]
        self._transmit(address, self._head + write_destination(prefix) + b"".join(parts))
