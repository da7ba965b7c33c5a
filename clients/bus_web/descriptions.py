"""Descriptions of types on the bus. A `Model` uses them to show the difference between two types of one
name.
"""

import asyncio

from bus.errors import BusError, ConfigurationError
from bus.node import Node

__all__ = ["Descriptions"]

_ANSWER_S = 2.0
_MOST = 1000


class Descriptions:
    """Descriptions of types requested so far; a `Model` takes it as `describe`."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: dict[tuple[str, str], bytes | None] = {}
        """None: no endpoint has the type any more."""
        self._wanted: dict[tuple[str, str], None] = {}

    def __call__(self, type_name: str, type_hash: str) -> bytes | None:
        """None if the description is not known yet: call `ask`."""
        kind = (type_name, type_hash)
        if kind not in self._known:
            self._wanted[kind] = None
        return self._known.get(kind)

    async def ask(self) -> bool:
        """Ask the bus for the wanted descriptions; returns whether more are known now. Stops if busd does not
        answer.
        """
        before = len(self._wanted)
        for kind in [*self._wanted]:
            try:
                async with asyncio.timeout(_ANSWER_S):
                    found: bytes | None = (await self._node.get_schema(*kind)).encoded
            except ConfigurationError:
                found = None
            except (BusError, TimeoutError):
                break
            del self._wanted[kind]
            if len(self._known) >= _MOST:
                del self._known[next(iter(self._known))]
            self._known[kind] = found
        return len(self._wanted) < before
