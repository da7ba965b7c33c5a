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

__all__ = ["ServiceBase", "ServiceCore"]


class ServiceCore:
    """Base of ServerCore and ClientCore, the parts of a service's two ends that users do not see.

    The user's object refers to the core, and the core does not know the user's object.
    """

    other = ""
    """The name of the other end in warnings."""
    type_consequence = ""
    """The consequence of different types, in warnings."""

    requests: Publisher[Any] | Subscription[Any]
    replies: Publisher[Any] | Subscription[Any]

    def __init__(self, node: NodeContext, service: str, service_type: Any, qos: QoSProfile) -> None:
        self.service_name = service
        self.type: Any = service_type
        self.qos = qos
        self.support: ServiceSupport = service_support(service_type)
        self.logger = node.logger
        self._node = node

    # --- for the user's object

    @property
    def endpoints(self) -> tuple[EndpointCore[Any], EndpointCore[Any]]:
        """The endpoints in the order of their declaration; they are closed in reverse order."""
        raise NotImplementedError

    def counts(self) -> str:
        """Counts for `repr`, at any time and from any thread."""
        raise NotImplementedError

    def describe_state(self) -> str:
        """As `EndpointCore.describe_state`."""
        return core_of(self.requests).describe_state()

    async def close(self) -> None:
        """As `close` of the user's object."""
        first, second = self.endpoints
        try:
            await second.close()
        finally:
            await first.close()

    # --- for the two ends

    def end(self, reason: BusError) -> None:
        """End: nothing arrives any more."""
        raise NotImplementedError

    def make_publisher(
        self, topic: str, support: TypeSupport[Any], matched: Callable[[MatchedChange], object] | None = None
    ) -> Publisher[Any]:
        return Publisher(
            self._node,
            topic,
            support,
            self.qos,
            PublisherEvents(matched=matched, **self._warnings(topic)),
        )

    def make_subscription(
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
        core_of(subscription).on_end = self.end
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
            self.logger,
            f"Incompatible type of service '{self.service_name}', {self.type_consequence}. "
            f"(node {event.node}: {event.text})",
        )

    def _warn_of_qos(self, event: IncompatibleQoS) -> None:
        warn(
            self.logger,
            f"New {self.other} discovered of service '{self.service_name}', with incompatible QoS. "
            f"Last incompatible policy: {event.policy} (node {event.node}: {event.text.rstrip(';')})",
        )


class ServiceBase:
    """Base of ServiceServer and ServiceClient; not made by users."""

    _core: ServiceCore

    def __init__(self, core: ServiceCore) -> None:
        self._core = core
        self.service_name: str = core.service_name
        """The service's full name."""
        self.type: Any = core.type
        """The class with `Request` and `Response`."""
        self.qos: QoSProfile = core.qos
        """The policies that it was made with."""

    def __repr__(self) -> str:
        core = self._core
        name = f"{core.describe_state()}{self.service_name} {core.support.name}"
        return f"<{type(self).__name__} {name} ({in_words(self.qos)}) {core.counts()}>"
