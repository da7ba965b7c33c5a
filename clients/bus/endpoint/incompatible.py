"""Endpoints on the topic that an endpoint does not match: their number, an event or a warning for each.

If the types differ, this requests the other description from the broker, to describe the difference.
"""

import asyncio
from collections.abc import Callable
from typing import Any, Protocol

import msgspec

from bus.diagnostics.provoked import is_worth_asking, warn
from bus.errors import BusError
from bus.events import IncompatibleQoS, IncompatibleType
from bus.link.link import Link
from bus.logger import Logger
from bus.types.support import TypeSupport
from bus.wire import messages as m
from bus.wire.layout import ACCESS

__all__ = ["IncompatibleEndpoints"]


class _Endpoint(Protocol):
    """The endpoint that does not match the others."""

    kind: str
    consequence: str
    topic_name: str
    support: TypeSupport[Any]
    link: Link
    logger: Logger
    events: Any

    def describe_incompatible_qos(self) -> str: ...

    def notify(self, callback: Callable[[Any], object] | None, event: Any) -> None: ...


class IncompatibleEndpoints:
    """The incompatible endpoints reported to `core`."""

    def __init__(self, core: _Endpoint) -> None:
        self._core = core
        self._by_qos = 0
        self._by_type = 0
        self._explaining: set[asyncio.Task[None]] = set()

    def add(self, message: m.Incompatible) -> None:
        """Add an incompatible endpoint, reported by the broker."""
        if message.type_hash and is_worth_asking():
            self._explaining.add(self._core.link.loop.create_task(self._explain(message)))
        else:
            self._report(message)

    def end(self) -> None:
        """End, because the endpoint is closed."""
        for task in self._explaining:
            task.cancel()

    async def _explain(self, message: m.Incompatible) -> None:
        """Describe the difference between the two definitions of the type."""
        from bus.types.diff import difference

        core, task = self._core, asyncio.current_task()
        try:
            own = core.support.description
            other = await core.link.description(core.support.name, message.type_hash)
            found = difference(own, other) if core.kind == "publisher" else difference(other, own)
        except (BusError, TimeoutError):
            found = None  # the other endpoint has left: the hashes must be enough
        finally:
            assert task is not None
            self._explaining.discard(task)
        if found is not None:
            text = f"both call it {core.support.name}, but {found}"
            message = msgspec.structs.replace(message, text=text)
        self._report(message)

    def _report(self, message: m.Incompatible) -> None:
        core = self._core
        if message.policy == ACCESS:  # without an event: in ROS 2 the other endpoint would not exist
            text = f"node {message.node} was denied access to '{core.topic_name}': {message.text}"
            warn(core.logger, text)
            return
        if message.policy == "TYPE":
            self._by_type += 1
            event: Any = IncompatibleType(self._by_type, 1, message.text, message.node)
            callback: Callable[[Any], object] | None = core.events.incompatible_type
            text = f"Incompatible type on topic '{core.topic_name}', {core.consequence}."
        else:
            self._by_qos += 1
            event = IncompatibleQoS(self._by_qos, 1, message.policy, message.text, message.node)
            callback = core.events.incompatible_qos
            text = f"{core.describe_incompatible_qos()}. Last incompatible policy: {message.policy}"
        if callback is not None:
            core.notify(callback, event)
        else:
            warn(core.logger, f"{text} (node {message.node}: {message.text.rstrip(';')})")
