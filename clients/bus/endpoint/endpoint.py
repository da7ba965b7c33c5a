"""The common public methods of publishers and subscriptions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import msgspec

from bus.base.awaited import done_anyway
from bus.endpoint.core import EndpointCore
from bus.endpoint.matches import Match
from bus.qos import QoSProfile, in_words

if TYPE_CHECKING:  # few programs need it
    from bus.schema import MessageSchema

__all__ = ["Endpoint", "core_of"]

M = TypeVar("M", bound=msgspec.Struct)
C = TypeVar("C", covariant=True)


class Endpoint(Generic[M]):
    """Base of Publisher and Subscription; not made by users."""

    _core: EndpointCore[M]

    def __init__(self, core: EndpointCore[M]) -> None:
        self._core = core
        self.topic_name: str = core.topic_name
        """The topic's full name."""
        self.node_name: str = core.node_name
        """The full name of its node."""
        self.type: type[M] = core.support.cls
        """The message class; `bytes` if messages stay encoded because there is no class."""
        self.qos: QoSProfile = core.qos
        """The policies that it was made with."""
        self.gid: bytes = core.gid
        """16 bytes that no other endpoint has, on this machine or in another run."""

    def __repr__(self) -> str:
        kind, core = type(self).__name__, self._core
        state, qos = core.describe_state(), in_words(self.qos)
        return f"<{kind} {state}{self.topic_name} {core.support.name} ({qos}) {self._counts()}>"

    @property
    def schema(self) -> MessageSchema:
        """Its type, as it is described on the bus."""
        from bus.schema import schema_of

        return schema_of(self._core.support)

    @property
    def matches(self) -> tuple[Match, ...]:
        """The endpoints matched with this one now; none while busd is away or once this one is closed."""
        return tuple(self._core.matches.values())

    def report_besides(
        self, *, samples: int = 0, bytes: int = 0, dropped: Mapping[str, int] | None = None
    ) -> None:
        """Add totals to this endpoint's counters in the graph; for bridges, with messages by other routes.

        `samples` and their `bytes` crossed to the other bus. `dropped` is by reason, a text of up to 32
        characters. Each call replaces the figures of the previous call.
        """
        self._core.report_besides(samples, bytes, dropped or {})

    @done_anyway
    async def close(self) -> None:
        """Leave the graph; a publisher first hands over published messages. Closing twice is allowed.

        Handing over takes 5 s at most; the log says how many messages were lost. Calls that wait on this
        endpoint raise ConnectionClosed. After a cancellation it is closed; messages not yet handed over are
        lost.
        """
        await self._core.close()

    def _counts(self) -> str:
        """Counts for `repr`, at any time and from any thread."""
        raise NotImplementedError


class _HasCore(Protocol[C]):
    @property
    def _core(self) -> C: ...


def core_of(endpoint: _HasCore[C]) -> C:
    """The part of a publisher, subscription, server or client of a service that users do not see.

    It is for other modules of this library.
    """
    return endpoint._core
