"""How types of the bus are told to clients: as ROS 2 describes them, with messages in CDR."""

import asyncio

from bus.errors import BusError, ConfigurationError
from bus.node import Node
from bus_ros.cdr import Codec, codec_of
from bus_web.foxglove.channels import Kind

__all__ = ["Formats"]

_ANSWER_S = 2.0
_MOST = 4096


class Formats:
    """The codecs of types, asked for once for all clients of `node`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: dict[Kind, Codec | str] = {}

    async def find(self, kind: Kind) -> Codec | str | None:
        """A text says why the type has none; None where the bus doesn't tell now: ask again later."""
        known = self._known.get(kind)
        if known is not None:
            return known
        try:
            async with asyncio.timeout(_ANSWER_S):
                schema = await self._node.get_schema(*kind)
        except (BusError, TimeoutError):
            return None
        try:
            known = codec_of(schema)
        except ConfigurationError as error:
            known = str(error)
        if len(self._known) >= _MOST:
            del self._known[next(iter(self._known))]
        self._known[kind] = known
        return known
