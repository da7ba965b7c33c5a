"""The common part of both ends of a service: two endpoints with a common life, and their warnings.

Owns: the policies and events of the two endpoints, and the order of their close. Must not know: the end to
which it belongs, nodes, graphs.
"""

from collections.abc import Callable
from typing import Any

from bus.base.callbacks import ignore
from bus.diagnostics.provoked import warn
from bus.endpoint.core import EndpointCore, NodeContext
from bus.endpoint.endpoint import core_of
from bus.errors import BusError
from bus.events import IncompatibleQoS, IncompatibleType, MatchedChange, PublisherEvents, SubscriptionEvents
from bus.names import request_topic
from bus.publisher import Publisher
from bus.qos import QoSProfile, in_words
from bus.subscription import Subscription
from bus.types.service import ServiceSupport, keeping_all, service_support
from bus.types.support import TypeSupport

__all__ = ["ServiceBase"]


class ServiceBase:
    """Base of ServiceServer and ServiceClient; not made by users."""

    _other = ""
    """The name of the other end in warnings."""
    _type_consequence = ""
    """The consequence of different types, in warnings."""

    _requests: Publisher[Any] | Subscription[Any]
    _replies: Publisher[Any] | Subscription[Any]

    def __init__(self, node: NodeContext, service: str, service_type: Any, qos: QoSProfile) -> None:
        self.service_name = service
        """The service's full name."""
        self.type: Any = service_type
        """The class with `Request` and `Response`."""
        self.qos = qos
        """The policies that it was made with."""
        self._support: ServiceSupport = service_support(service_type)
        self._node = node
        self._logger = node.logger

    def __repr__(self) -> str:
        name = f"{core_of(self._requests).describe_state()}{self.service_name} {self._support.name}"
        return f"<{type(self).__name__} {name} ({in_words(self.qos)}) {self._counts()}>"

    @property
    def _endpoints(self) -> tuple[EndpointCore[Any], EndpointCore[Any]]:
        """The endpoints in the order of their declaration; they are closed in reverse order."""
        raise NotImplementedError

    def _counts(self) -> str:
        """Counts for `repr`, at any time and from any thread."""
        raise NotImplementedError

    def _end(self, reason: BusError) -> None:
        """End: nothing arrives any more."""
        raise NotImplementedError

    async def _close(self) -> None:
        first, second = self._endpoints
        try:
            await second.close()
        finally:
            await first.close()

    def _make_publisher(
        self, topic: str, support: TypeSupport[Any], matched: Callable[[MatchedChange], object] | None = None
    ) -> Publisher[Any]:
        return Publisher(
            self._node,
            topic,
            support,
            self.qos,
            PublisherEvents(matched=matched, **self._warnings(topic)),
        )

    def _make_subscription(
        self,
        topic: str,
        support: TypeSupport[Any],
        callback: Callable[[Any], object],
        matched: Callable[[MatchedChange], object] | None = None,
    ) -> Subscription[Any]:
        subscription: Subscription[Any] = Subscription(
            self._node,
            topic,
            support,
            keeping_all(self.qos),
            SubscriptionEvents(matched=matched, **self._warnings(topic)),
            callback,
        )
        core_of(subscription).on_end = self._end
        return subscription

    def _warnings(self, topic: str) -> dict[str, Callable[[Any], object]]:
        # Different types differ on both topics, so one warning is enough.
        warns_of_type = topic == request_topic(self.service_name)
        return {
            "incompatible_type": self._warn_of_type if warns_of_type else ignore,
            "incompatible_qos": self._warn_of_qos,
        }

    def _warn_of_type(self, event: IncompatibleType) -> None:
        warn(
            self._logger,
            f"Incompatible type of service '{self.service_name}', {self._type_consequence}. "
            f"(node {event.node}: {event.text})",
        )

    def _warn_of_qos(self, event: IncompatibleQoS) -> None:
        warn(
            self._logger,
            f"New {self._other} discovered of service '{self.service_name}', with incompatible QoS. "
            f"Last incompatible policy: {event.policy} (node {event.node}: {event.text.rstrip(';')})",
        )
