"""The internal part of a client: requests leave on a hidden topic, answers arrive on another.

Owns: the client's two endpoints, and its waiting calls. Must not know: the user's object, servers, nodes,
graphs.

The subscription to replies is declared before the publisher of requests. So no answer comes too early.
"""

import asyncio
from collections.abc import Callable
from itertools import count
from time import monotonic_ns
from typing import Any, Final

import msgspec

from bus.delivery.port import RETURN_S
from bus.diagnostics.provoked import warn
from bus.endpoint.core import EndpointCore, NodeContext
from bus.endpoint.endpoint import core_of
from bus.endpoint.subscription_core import MessageInfo, SubscriptionCore
from bus.errors import BusError, LocalProtocolError, ServiceError, ServiceUnavailable, again
from bus.events import MatchedChange
from bus.names import reply_topic, request_topic
from bus.publisher import Publisher
from bus.qos import QoSProfile
from bus.service.base import ServiceCore
from bus.subscription import Subscription
from bus.types.service import Reply
from bus.vocabulary import Route

__all__ = ["MAX_PENDING", "CallLost", "ClientCore", "ServiceClientStatistics"]

MAX_PENDING: Final = 1000
"""Most calls of one client that may wait for answers: the number that both sides keep by default."""

# The report that a server has left may overtake its last answer, because they use different queues.
_GRACE_S: Final = 0.5

_LOOK_S: Final = 1.0
"""Interval of checks of doubtful calls."""

_FIRST_LOOKS: Final = 2
"""Checks until the first question about a call to a server on another bus."""

_MOST_LOOKS: Final = 16
"""The longest interval between two questions about one call, in checks."""


class ServiceClientStatistics(msgspec.Struct, frozen=True):
    """Totals of one client.

    For example:

        print(client.statistics().pending)
    """

    requests: int
    """Requests sent."""
    responses: int
    """Answers to waiting calls, including error answers."""
    errors: int
    """Error answers among `responses`."""
    late: int
    """Answers without a waiting call: the call was cancelled, or another server answered it."""
    pending: int
    """Calls that wait now."""
    servers: int
    """Servers matched now."""


class CallLost(ServiceUnavailable):
    """The request or the answer was lost: with busd, which ended during the call, or by a bridge."""

    def __init__(self, service: str, *, is_bridged: bool = False) -> None:
        super().__init__(
            service,
            "the request or its answer was lost on the way to or from another bus"
            if is_bridged
            else "busd, or a connection to it, has ended meanwhile, and the request or its answer is lost",
        )


class _Call:
    """A pending call: its servers, and the function for its answer."""

    __slots__ = ("asked", "deliver", "denied", "is_doubtful", "left", "looks", "looks_left")

    def __init__(self, asked: frozenset[bytes], deliver: Callable[[int, Any], object]) -> None:
        self.asked = asked
        self.deliver = deliver
        self.denied: set[bytes] = set()
        """Servers that do not work on it, by the gids of their publishers of replies."""
        self.left: frozenset[bytes] = frozenset()
        """Servers that have left since, or have only lost their connection."""
        self.is_doubtful = False
        """The client must ask the server whether it knows the call: busd has ended since, or was away, or a
        bridge is on the way, which may lose messages."""
        self.looks = self.looks_left = 0
        """The number of checks between the last question and the next one: all of them, and those left."""

    @property
    def is_lost(self) -> bool:
        """Whether all servers that got it have left."""
        return bool(self.left) and not self.asked

    def doubt(self) -> None:
        """The client must ask about it soon."""
        self.is_doubtful = True
        self.looks = self.looks_left = 0


class ClientCore(ServiceCore):
    """The part of a ServiceClient that users do not see."""

    other = "server"
    type_consequence = "no requests will be sent to its server"

    requests: Publisher[Any]
    replies: Subscription[Any]

    def __init__(
        self,
        node: NodeContext,
        service: str,
        service_type: Any,
        qos: QoSProfile,
    ) -> None:
        super().__init__(node, service, service_type, qos)
        self._loop = node.link.loop
        self._numbers = count(1)
        self._calls: dict[int, _Call] = {}
        self._servers: frozenset[bytes] = frozenset()
        self._is_bridged = False
        """Whether a server is on another bus."""
        self._has_one_replier = True
        """False with several servers: then a reply is taken with its info, to know its publisher."""
        self._grace: asyncio.TimerHandle | None = None
        self._doubts: asyncio.TimerHandle | None = None
        self._back_ns = 0
        """The time at which the present busd was first seen, while there are doubtful calls."""
        self._sent = self._answered = self._errors = self._late = 0
        self.requests = self.make_publisher(request_topic(service), self.support.requests, self._on_matched)
        self._requests_core = core_of(self.requests)
        self.gid = self.requests.gid
        """Identifies the client in its requests and their answers."""
        self.replies = self.make_subscription(
            reply_topic(service), self.support.replies(self.gid), self._take, self._on_replier
        )
        self._replies_core: SubscriptionCore[Any] = core_of(self.replies)

    # --- for the user's object

    @property
    def endpoints(self) -> tuple[EndpointCore[Any], EndpointCore[Any]]:
        return core_of(self.replies), self._requests_core

    def counts(self) -> str:
        return f"servers={len(self._servers)} requests={self._sent} pending={len(self._calls)}"

    def forget(self, number: int) -> bool:
        """As `ServiceClient.forget`."""
        return self._calls.pop(number, None) is not None

    def is_ready(self) -> bool:
        """As `ServiceClient.service_is_ready`."""
        return self._requests_core.count_ready() > 0

    def statistics(self) -> ServiceClientStatistics:
        """As `ServiceClient.statistics`."""
        return ServiceClientStatistics(
            requests=self._sent,
            responses=self._answered,
            errors=self._errors,
            late=self._late,
            pending=len(self._calls),
            servers=len(self._servers),
        )

    # --- for calls, actions and the facade

    def check_served(self) -> None:
        """Raise ServiceUnavailable if no server exists; unknown while busd is away. Raises as
        `ServiceClient.call`."""
        if not self._servers and self._requests_core.id:
            if self._requests_core.refusal is not None:
                raise again(self._requests_core.refusal)
            raise ServiceUnavailable(self.service_name, "no server exists now; see wait_for_service")

    def send(self, request: Any, deliver: Callable[[int, Any], object]) -> int:
        """As `ServiceClient.send_request`; `deliver` is called as its `on_response`."""
        if len(self._calls) >= MAX_PENDING:
            raise LocalProtocolError(
                f"{len(self._calls)} calls of service '{self.service_name}' wait for their answers already"
            )
        number = next(self._numbers)
        payload = self.support.encode_request(self.gid, number, request)
        call = self._calls[number] = _Call(self._servers, deliver)  # first: the answer may come at once
        call.is_doubtful = self._is_bridged or not self._requests_core.id
        if self._is_bridged:
            call.looks_left = _FIRST_LOOKS  # most answers come sooner
        is_sent = False
        try:
            is_sent = self.requests.publish_encoded(payload)
        finally:
            if not is_sent:
                self.forget(number)
        if not is_sent:
            return 0
        self._sent += 1
        if call.is_doubtful and self._doubts is None:
            self._loop.call_soon_threadsafe(self._doubt)
        return number

    # --- inside

    def _take(self, reply: Reply) -> None:
        if reply.client == self.gid:
            if reply.error:
                self._settle(reply.number, ServiceError(self.service_name, reply.error))
            elif reply.body is not None:
                self._settle(reply.number, reply.body)
            else:
                repliers = self._repliers
                self._deny(reply.number, next(iter(repliers)) if len(repliers) == 1 else b"")

    def _take_from_one(self, reply: Reply, info: MessageInfo) -> None:
        """As `_take`, with several servers. It costs more."""
        if reply.client == self.gid and not reply.error and reply.body is None:
            self._deny(reply.number, info.publisher_gid)
        else:
            self._take(reply)

    def _deny(self, number: int, replier: bytes) -> None:
        """A server does not work on a call. If no server does, the call is lost."""
        call = self._calls.get(number)
        if call is None:
            self._late += 1
            return
        call.denied.add(replier)
        repliers = self._repliers
        # A server's publisher of replies may come later than its subscription, or never, with another QoS.
        are_all_known = len(repliers) >= len(self._servers) or call.looks >= _MOST_LOOKS
        if repliers <= call.denied and are_all_known:
            self._settle(number, CallLost(self.service_name, is_bridged=self._is_bridged))

    @property
    def _repliers(self) -> frozenset[bytes]:
        """Gids of the servers' publishers of replies."""
        return frozenset(one.gid for one in self._replies_core.matches.values())

    def _on_replier(self, change: MatchedChange) -> None:
        is_one = len(self._replies_core.matches) < 2
        if is_one is not self._has_one_replier:
            self._has_one_replier = is_one
            self._replies_core.replace_callback(self._take if is_one else self._take_from_one)

    def _settle(self, number: int, outcome: Any) -> None:
        call = self._calls.pop(number, None)
        if call is None:
            self._late += 1
            return
        self._answered += 1
        self._errors += isinstance(outcome, ServiceError)
        call.deliver(number, outcome)

    def _on_matched(self, change: MatchedChange) -> None:
        matches = self.requests.matches
        before, self._servers = self._servers, frozenset(one.gid for one in matches)
        self._is_bridged = any(one.route == Route.BRIDGE for one in matches)
        if change.current_count_change > 0 and len(self._servers) > 1:
            warn(
                self.logger,
                f"service '{self.service_name}' is served {len(self._servers)} times, {change.node} is the "
                "last one: each gets every request, and the first answer counts",
            )
        gone, come = before - self._servers, self._servers - before
        if not self._requests_core.id:  # busd is away, and the servers may still exist
            for call in tuple(self._calls.values()):
                call.doubt()
            self._doubt()
            return
        for call in tuple(self._calls.values()):
            if back := call.left & come:  # it has lost its connection, and perhaps the call or the answer
                call.left, call.asked = call.left - back, call.asked | back
                call.doubt()
                self._doubt()
        if self._doubts is not None:
            self._ask(is_new=change.current_count_change > 0)
        if not gone:
            return
        for call in tuple(self._calls.values()):
            call.left, call.asked = call.left | call.asked & gone, call.asked - gone
        if any(call.is_lost for call in tuple(self._calls.values())):
            if self._grace is not None:
                self._grace.cancel()
            self._grace = self._loop.call_later(_GRACE_S, self._give_up)

    def _give_up(self) -> None:
        """Fail calls whose servers have left: they get no answer any more."""
        self._grace = None
        while (taken := self.replies.take()) is not None:
            self._take_from_one(*taken)
        reason = ServiceUnavailable(self.service_name, "it has left before it answered")
        self._fail([number for number, call in tuple(self._calls.items()) if call.is_lost], reason)

    def _doubt(self) -> None:
        """Check calls that may be lost with busd, until none is doubtful."""
        if not self._requests_core.id:
            self._back_ns = 0
        if self._doubts is None and self._calls:
            self._doubts = self._loop.call_later(_LOOK_S, self._check_doubts)

    def _check_doubts(self) -> None:
        self._doubts = None
        if self._requests_core.id:
            now_ns = monotonic_ns()
            self._back_ns = self._back_ns or now_ns
            if now_ns - self._back_ns >= RETURN_S * 1e9:
                self._give_up_absent()
            self._ask(is_new=False)
        else:
            self._back_ns = 0
        if any(call.is_doubtful for call in tuple(self._calls.values())):
            self._doubts = self._loop.call_later(_LOOK_S, self._check_doubts)

    def _ask(self, *, is_new: bool) -> None:
        """Ask the servers about the state of doubtful calls; `is_new`: one has come just now.

        A server's answer comes after its earlier answers. A server that still works on a call does not
        answer, and a bridge may lose the question or the answer. So the client asks again, after one look,
        two, four and so on. Each of several servers gets the question.
        """
        if not self._servers:
            return
        for number, call in tuple(self._calls.items()):
            if not call.is_doubtful or call.is_lost or not call.asked <= self._servers:
                continue
            call.looks_left -= 1
            if call.looks_left > 0 and not is_new:
                continue
            if self.requests.publish_encoded(self.support.encode_question(self.gid, number)):
                call.looks = call.looks_left = min(2 * call.looks or 1, _MOST_LOOKS)
            # A call from the time without busd was for unknown servers.
            call.asked = call.asked or self._servers

    def _give_up_absent(self) -> None:
        """Fail calls whose server is not back by now."""
        lost: list[int] = []
        for number, call in tuple(self._calls.items()):
            if call.is_doubtful:
                left = call.asked & self._servers
                if not (left if call.asked else self._servers):
                    lost.append(number)
                call.asked = left
        self._fail(lost, ServiceUnavailable(self.service_name, "it has left while busd was away"))

    def end(self, reason: BusError) -> None:
        for timer in (self._grace, self._doubts):
            if timer is not None:
                timer.cancel()
        self._fail(list(self._calls), reason)

    def _fail(self, numbers: list[int], reason: BusError) -> None:
        for number in numbers:
            if (call := self._calls.pop(number, None)) is not None:
                call.deliver(number, reason)
