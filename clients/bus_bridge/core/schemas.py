"""The types of far endpoints: asks for each description once, and checks it before it is used here."""

import asyncio
from collections.abc import Callable

from bus.errors import BusError, ConfigurationError
from bus.node import Node
from bus.schema import MessageSchema
from bus.types.schema import build
from bus_bridge.engine import Engine, FarEndpoint
from bus_bridge.errors import BridgeError, in_words

__all__ = ["Schemas"]

_MOST = 4096
_AT_ONCE = 32
_RETRY_S = 2.0

_Key = tuple[str, ...]


class Schemas:
    """Asks busd first, then the engine. `on_lie(endpoint, reason)` is called for a false description.

    `max_bytes` limits one description.
    """

    def __init__(
        self, node: Node, engine: Engine, max_bytes: int, on_lie: Callable[[FarEndpoint, str], object]
    ) -> None:
        self._node = node
        self._engine = engine
        self._max_bytes = max_bytes
        self._on_lie = on_lie
        self._loop = asyncio.get_running_loop()
        self._found: dict[_Key, MessageSchema] = {}
        self._failed: dict[_Key, tuple[str, float]] = {}
        self._asking: dict[_Key, asyncio.Task[None]] = {}
        self._places = asyncio.Semaphore(_AT_ONCE)
        self.on_found: Callable[[], object] = lambda: None
        """Called when a new `get` may give a result."""

    def get(self, endpoint: FarEndpoint) -> MessageSchema | None:
        """The schema of a far endpoint; None while the search goes on.

        Raises BridgeError if neither busd nor the engine has it, or if it is broken.
        """
        key = _key(endpoint)
        if (found := self._found.get(key)) is not None:
            return found
        if key in self._failed:
            text, until_s = self._failed[key]
            if self._loop.time() < until_s:
                raise BridgeError(text)
            del self._failed[key]
        if key not in self._asking:
            self._asking[key] = self._loop.create_task(self._ask(key, endpoint), name="ask for a type")
        return None

    def close(self) -> None:
        for task in self._asking.values():
            task.cancel()

    async def _ask(self, key: _Key, endpoint: FarEndpoint) -> None:
        try:
            async with self._places:
                schema = await self._find(endpoint)
        except TimeoutError as error:
            self._fail(key, str(error) or "the far bus did not answer the request for its definition")
        except Exception as error:  # an engine's fault must not end the bridge
            self._fail(key, in_words(error))
        else:
            if len(self._found) >= _MOST:
                self._found.clear()
            self._found[key] = schema
        finally:
            self._asking.pop(key, None)
            self.on_found()

    async def _find(self, endpoint: FarEndpoint) -> MessageSchema:
        if endpoint.type_hash:
            try:
                return await self._node.get_schema(endpoint.type_name, endpoint.type_hash)
            except ConfigurationError:
                pass  # busd does not know it
        schema = await self._engine.find_schema(endpoint)
        if wrong := self._wrong(endpoint, schema):
            self._on_lie(endpoint, wrong)
            raise BridgeError(wrong)
        return schema

    def _wrong(self, endpoint: FarEndpoint, schema: MessageSchema) -> str:
        what = f"the description of {endpoint.type_name}"
        if schema.type_name != endpoint.type_name:
            return f"{what} is one of {schema.type_name[:255]}"
        if len(schema.encoded) > self._max_bytes:
            return f"{what} has {len(schema.encoded)} bytes; the limit is {self._max_bytes}"
        try:
            build(schema.description)
        except BusError as error:
            return f"{what} is broken: {error}"
        return ""

    def _fail(self, key: _Key, text: str) -> None:
        if len(self._failed) >= _MOST:
            self._failed.clear()
        self._failed[key] = text, self._loop.time() + _RETRY_S


def _key(endpoint: FarEndpoint) -> _Key:
    if endpoint.type_hash:
        return endpoint.type_name, endpoint.type_hash
    return endpoint.type_name, "", endpoint.node  # the type may differ from node to node
