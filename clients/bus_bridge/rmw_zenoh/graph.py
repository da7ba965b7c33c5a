"""The graph of a domain, from its tokens: nodes and endpoints of other programs, for the bridge.

Owns: which tokens count, the nodes that they name, and the descriptions of endpoints on the bus. All tokens
are hostile. Must not know: zenoh, the loop.

A client or server is one token, and on the bus two endpoints. The publisher among them has the gid of the
token, which the attachments of calls name.
"""

from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from bus.errors import ConfigurationError
from bus.names import (
    reply_topic,
    request_topic,
    validate_full_topic_name,
)
from bus.schema import MessageSchema
from bus.types.service import keeping_all
from bus_bridge.engine import EndpointKind, FarEndpoint, FarNode, FarSide
from bus_bridge.errors import BridgeError
from bus_bridge.rmw_zenoh.keys import EndpointToken, NodeToken, gid_of, parse_token
from bus_bridge.ros2.calls import OF_SERVICES
from bus_bridge.ros2.known_types import MOST_UNKNOWN, TOO_MANY_UNKNOWN, KnownTypes
from bus_bridge.ros2.node_names import is_right_node
from bus_bridge.ros2.service_types import KnownServices

__all__ = ["MOST_TOKENS", "RosGraph", "ServiceKind", "announcer_of", "session_of"]

MOST_TOKENS: Final = 30_000
"""Tokens of all sessions together. The bridge shows at most 11,000 nodes and endpoints of a domain."""
_FEW_TOKENS: Final = 1000
"""A session with fewer tokens is not refused for their number."""
_MOST_REFUSED: Final = 1000
_ANNOUNCER: Final = "session "


class ServiceKind(NamedTuple):
    """The properties that servers and clients must have in common."""

    service: str
    type_name: str
    type_hash: str


class _Known(NamedTuple):
    """What a token stands for."""

    node: NodeToken
    token: EndpointToken | None = None
    endpoints: tuple[FarEndpoint, ...] = ()
    """Reported endpoints, in the order in which they are removed."""


class RosGraph:
    """All nodes and endpoints of the domain's other programs. `own` is the zenoh id of our session.

    `on_came` is called with the gid of each publisher of a topic that is reported, and `on_gone` with the gid
    of each publisher that has gone.
    """

    def __init__(
        self,
        bus: str,
        own: str,
        types: KnownTypes,
        services: KnownServices,
        far: FarSide,
        on_came: Callable[[bytes], object],
        on_gone: Callable[[bytes], object],
    ) -> None:
        self._bus = bus
        self._own = own
        self._types = types
        self._services = services
        self._far = far
        self._on_came, self._on_gone = on_came, on_gone
        self._known: dict[str, _Known] = {}
        self._tokens: Counter[str] = Counter()
        """The number of tokens of each session."""
        self._nodes: dict[str, dict[str, None]] = {}
        """The tokens that name each node, by its key."""
        self._unknown: dict[str, None] = {}
        """Tokens of endpoints whose types are not known; they may become known."""
        self.refused: OrderedDict[str, None] = OrderedDict()
        """Sessions that are refused. A program that starts again has another session."""
        self.publishers: dict[bytes, EndpointToken] = {}
        """Publishers of topics that were reported, by gid."""
        self._servers: dict[ServiceKind, dict[bytes, str]] = {}
        self._is_full = False
        """Whether new tokens are left out: there are too many, but no session has many of them."""

    @property
    def sessions(self) -> int:
        """The number of sessions with tokens."""
        return len(self._tokens)

    def servers_of(self, kind: ServiceKind) -> Mapping[bytes, str]:
        """The present servers of other programs: their sessions, by gid."""
        return self._servers.get(kind, {})

    def came(self, key: str) -> None:
        """Handle a token that has come; it may have come before."""
        token = parse_token(key)
        if token is None:
            self._far.warn(f"a token of ROS 2 is left out, because it can't be read: {key!r:.300}")
            return
        node = token.node if isinstance(token, EndpointToken) else token
        session = node.session
        if key in self._known or node.is_of_busd or session == self._own or session in self.refused:
            return
        if not is_right_node(node.namespace, node.name, self._far.warn):
            return
        if len(self._known) >= MOST_TOKENS:
            self._make_room()
            if self._is_full or session in self.refused:
                return
        self._known[key] = _Known(node, token if isinstance(token, EndpointToken) else None)
        self._tokens[session] += 1
        of_node = self._nodes.setdefault(node.key, {})
        of_node[key] = None
        if len(of_node) == 1:
            self._far.node_added(
                FarNode(node.key, self._bus, node.name, node.namespace, announcer=announcer_of(session))
            )
        if isinstance(token, EndpointToken):
            if token.kind == "SS":
                self._servers.setdefault(_kind_of(token), {})[gid_of(key)] = session
            self._report(key, token)

    def gone(self, key: str) -> None:
        """Handle a token that has gone; it need not be known."""
        known = self._known.pop(key, None)
        if known is None:
            return
        self._is_full = False
        self._unknown.pop(key, None)
        session = known.node.session
        self._tokens[session] -= 1
        if not self._tokens[session]:
            del self._tokens[session]
        if known.token is not None and known.token.kind == "SS":
            kind = _kind_of(known.token)
            servers = self._servers.get(kind, {})
            servers.pop(gid_of(key), None)  # a hostile token may have had the same gid
            if not servers:
                self._servers.pop(kind, None)
        for endpoint in known.endpoints:
            self.publishers.pop(endpoint.gid, None)
            self._far.endpoint_removed(endpoint.gid, known.node.key)
            if endpoint.kind == "publisher":
                self._on_gone(endpoint.gid)
        of_node = self._nodes[known.node.key]
        del of_node[key]
        if not of_node:
            del self._nodes[known.node.key]
            self._far.node_removed(known.node.key)

    def clear(self) -> None:
        """Forget all tokens: news about some of them were lost. Ask for the present ones afterwards."""
        for key in [*self._known]:
            self.gone(key)

    def types_changed(self) -> None:
        """Try endpoints of unknown types again, because a type has become known."""
        unknown, self._unknown = self._unknown, {}
        for key in unknown:
            known = self._known.get(key)
            if known is not None and known.token is not None:
                self._report(key, known.token)

    def refuse(self, announcer: str) -> None:
        """Refuse a session from now on. May be called while its news are reported: call `forget_refused`
        afterwards."""
        self.refused[session_of(announcer)] = None
        while len(self.refused) > _MOST_REFUSED:
            self.refused.popitem(last=False)

    def forget_refused(self) -> None:
        """Remove the tokens of refused sessions."""
        for key in [key for key, one in self._known.items() if one.node.session in self.refused]:
            self.gone(key)

    # --- inside

    def _make_room(self) -> None:
        """Refuse the session with most tokens, if it has many. Else there is no room for a new token."""
        if self._is_full:
            return
        most, count = self._tokens.most_common(1)[0]
        if count < _FEW_TOKENS:
            self._is_full = True
            self._far.warn(
                f"{MOST_TOKENS:,} tokens of {len(self._tokens):,} sessions of ROS 2 are there, which is the "
                "limit: nodes and endpoints that come now are left out until they are created again"
            )
            return
        self.refuse(announcer_of(most))
        self.forget_refused()
        self._far.warn(f"session {most} is refused: of {MOST_TOKENS} tokens it has announced {count}")

    def _report(self, key: str, token: EndpointToken) -> None:
        is_of_topic = token.kind in ("MP", "MS")
        what = f"topic {token.topic!r:.300}" if is_of_topic else f"service {token.topic!r:.300}"
        try:
            endpoints = self._of_topic(key, token) if is_of_topic else self._of_service(key, token)
        except BridgeError as error:
            if len(self._unknown) >= MOST_UNKNOWN:
                self._far.warn(TOO_MANY_UNKNOWN)
                return
            self._unknown[key] = None
            self._far.warn(f"{what} of ROS 2 is left out: {error}")
        except ConfigurationError as error:
            self._far.warn(f"{what} of ROS 2 is left out: {str(error).splitlines()[0]}")
        else:
            self._known[key] = self._known[key]._replace(endpoints=endpoints[::-1])
            for endpoint in endpoints:
                if is_of_topic and endpoint.kind == "publisher":
                    self.publishers[endpoint.gid] = token
                    self._on_came(endpoint.gid)
                self._far.endpoint_added(endpoint)

    def _of_topic(self, key: str, token: EndpointToken) -> tuple[FarEndpoint, ...]:
        validate_full_topic_name(token.topic)
        schema = self._types.find(token.type_name, token.type_hash).schema
        kind: EndpointKind = "publisher" if token.kind == "MP" else "subscription"
        gid, node = gid_of(key), token.node.key
        return (FarEndpoint(kind, gid, node, token.topic, schema.type_name, schema.type_hash, token.qos),)

    def _of_service(self, key: str, token: EndpointToken) -> tuple[FarEndpoint, ...]:
        """The subscription first: otherwise a server could answer before the mirror of the client's is
        there. No token has the key that its gid is made of: parts of keys are not empty."""
        requests, replies = request_topic(token.topic), reply_topic(token.topic)
        validate_full_topic_name(requests)
        types = self._services.find(token.type_name)
        if token.type_hash != types.type_hash:
            raise BridgeError(
                f"{token.type_name} is another type in ROS 2 ({token.type_hash[:19]}) than here "
                f"({types.type_hash[:19]}): one side has an older definition"
            )
        asked, answered = (requests, types.requests), (replies, types.replies)
        incoming, outgoing = (asked, answered) if token.kind == "SS" else (answered, asked)

        def endpoint(kind: EndpointKind, gid: bytes, topic: str, schema: MessageSchema) -> FarEndpoint:
            profile = OF_SERVICES if kind == "publisher" else keeping_all(OF_SERVICES)
            return FarEndpoint(kind, gid, token.node.key, topic, schema.type_name, schema.type_hash, profile)

        return (
            endpoint("subscription", gid_of(f"{key}//in"), *incoming),
            endpoint("publisher", gid_of(key), *outgoing),
        )


def _kind_of(token: EndpointToken) -> ServiceKind:
    return ServiceKind(token.topic, token.type_name, token.type_hash)


def announcer_of(session: str) -> str:
    """The bridge's name for a session, which only announces its own nodes."""
    return _ANNOUNCER + session


def session_of(announcer: str) -> str:
    """The zenoh id in an announcer's name."""
    return announcer.removeprefix(_ANNOUNCER)
