"""A participant in a DDS domain, and the entities that a bridge makes in it.

Owns: cyclonedds' configuration, its entities and its QoS objects. Must not know: ROS 2's names, the graph.
"""

import os
from collections.abc import Callable
from secrets import token_hex
from typing import Any, Final

from bus_bridge.dds import raw
from bus_bridge.dds.interfaces import LOOPBACK, address_of, check_interface, is_address
from bus_bridge.dds.options import DdsOptions
from bus_bridge.errors import BridgeError
from bus_bridge.extras import why_missing
from bus_bridge.rtps.parameters import FOREVER_NS
from bus_bridge.rtps.policies import AUTOMATIC, MANUAL_BY_TOPIC, TRANSIENT_LOCAL, VOLATILE, Policies

__all__ = ["Participant", "configuration", "policies_of", "user_data_in"]

_OTHER_VENDORS: Final = "1.1,1.3,1.15"
"""RTI, OpenDDS, Fast DDS: Cyclone refuses the type descriptions that Fast DDS sends with Kilted."""
_COMPATIBILITY: Final = (
    f"<Compatibility><IgnoreTypeInformation>{_OTHER_VENDORS}</IgnoreTypeInformation></Compatibility>"
    "<Internal><GenerateKeyhash>true</GenerateKeyhash></Internal>"
)
"""Without the hash of the key, Fast DDS does not understand that an endpoint or a participant has gone."""
_PARTICIPANTS: Final = (
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>"
)
_CALLS: Final = "<SPDPInterval>2 s</SPDPInterval>"
"""Our participant calls often, because ROS 2's nodes do not call on loopback by default, and do not know a
`--peer` here. So a node that starts after the bridge waits for the bridge's call. Cyclone's default is to
call rarely, and to forget a peer after 30 s without an answer."""
_SETTINGS: Final = (
    "<Internal><SocketReceiveBufferSize min='default' max='4 MB'/>"
    "<Watermarks><WhcHigh>8 MB</WhcHigh><WhcHighInit>2 MB</WhcHighInit></Watermarks></Internal>"
)


_ON_LOOPBACK: Final = "<MaxMessageSize>65500 B</MaxMessageSize><FragmentSize>60000 B</FragmentSize>"
"""Packets of loopback are long. With Cyclone's default, 1,344 bytes, the kernel's buffer of a receiver holds
the fewer bytes of a long message, because each packet takes memory of its own."""


def configuration(options: DdsOptions, user_uri: str = "") -> str:
    """Cyclone's configuration. The user's CYCLONEDDS_URI takes precedence, and replaces the network part.

    Raises BridgeError like `address_of`.
    """
    if user_uri:
        return f"<CycloneDDS><Domain>{_COMPATIBILITY}</Domain></CycloneDDS>,{user_uri}"
    peers, sizes = list(options.peers), ""
    if options.is_local:
        sizes = _ON_LOOPBACK
        address = options.interface if ":" in options.interface else LOOPBACK
        interface = f"<NetworkInterface address='{address}' multicast='false'/>"
        peers.append(address)
    else:
        kind = "address" if is_address(options.interface) else "name"
        is_quiet = options.discovery in ("OFF", "LOCALHOST")
        more = " multicast='false'" if is_quiet else ""
        interface = f"<NetworkInterface {kind}='{options.interface}'{more}/>"
        if is_quiet:  # nodes of this machine would be found by multicast
            peers.append(address_of(options.interface))
    listed = "".join(f"<Peer address='{peer}' PruneDelay='inf'/>" for peer in dict.fromkeys(peers))
    discovery = f"<Peers>{listed}</Peers>{_PARTICIPANTS}{_CALLS}"
    if options.discovery == "OFF":
        # Participants with different tags ignore each other.
        discovery = f"<ParticipantIndex>none</ParticipantIndex><Tag>busd_{token_hex(8)}</Tag>"
    return (
        f"<CycloneDDS><Domain><General><Interfaces>{interface}</Interfaces>{sizes}</General>"
        f"<Discovery>{discovery}</Discovery>"
        f"{_SETTINGS}</Domain></CycloneDDS>,<CycloneDDS><Domain>{_COMPATIBILITY}</Domain></CycloneDDS>"
    )


class Participant:
    """One participant; `close` ends it with all its entities.

    Callbacks run in Cyclone's threads. Raises BridgeError if cyclonedds is missing, or if the domain or the
    interface is not available.
    """

    def __init__(self, options: DdsOptions, user_data: bytes) -> None:
        try:
            from cyclonedds.core import DDSException, Listener, Policy, Qos
            from cyclonedds.domain import Domain, DomainParticipant
            from cyclonedds.pub import DataWriter, Publisher
            from cyclonedds.sub import DataReader, Subscriber
            from cyclonedds.topic import Topic
        except (ImportError, OSError) as error:
            why = why_missing("ros2")
            text = (
                f"the carrier cyclonedds is missing: {why}" if why else f"cyclonedds can't be loaded: {error}"
            )
            raise BridgeError(text) from None
        options.check()
        self._error = DDSException
        self._listener, self._policy, self._qos = Listener, Policy, Qos
        self._reader_class, self._writer_class, self._topic_class = DataReader, DataWriter, Topic
        uri = os.environ.get("CYCLONEDDS_URI", "")
        if options.interface and not uri:
            check_interface(options.interface)
        try:
            self._domain = Domain(options.domain, configuration(options, uri))
        except DDSException:
            raise BridgeError(_no_domain(options, uri)) from None
        try:
            self.entity = DomainParticipant(options.domain, Qos(Policy.Userdata(user_data)))
            self._publisher, self._subscriber = Publisher(self.entity), Subscriber(self.entity)
        except DDSException:
            raw.delete(self._domain)
            raise BridgeError(_no_domain(options, uri)) from None
        self.guid: bytes = self.entity.guid.bytes
        self._topics: dict[tuple[str, Any], tuple[Any, int]] = {}

    def leave(self) -> None:
        """End all entities of the participant. Cyclone's threads tell other participants meanwhile; then call
        `close`."""
        raw.delete(self.entity)

    def close(self) -> None:
        """End the participant; returns after the end of Cyclone's threads. A second call has no effect.

        News that they had not sent yet is lost. Then other participants wait for the end of the lease: ten
        seconds.
        """
        raw.delete(self.entity)
        raw.delete(self._domain)

    def make_writer(
        self,
        topic: str,
        idl_type: Any,
        policies: Policies,
        user_data: bytes,
        on_matched: Callable[[], object] | None,
    ) -> "Endpoint":
        """Make a writer, which never blocks. Raises BridgeError."""
        listener = self._listener()
        if on_matched is not None:
            listener = self._listener(on_publication_matched=lambda writer, status: on_matched())
        policy = self._policy
        more = [policy.WriterDataLifecycle(autodispose=False)]
        if policies.transient_local:
            limit = -1
            more.append(policy.DurabilityService(0, self._history(policies), limit, limit, limit))
        if policies.lifespan_ns < FOREVER_NS:
            more.append(policy.Lifespan(policies.lifespan_ns))
        return self._make(
            self._writer_class, self._publisher, topic, idl_type, policies, (user_data, more), listener
        )

    def make_reader(
        self,
        topic: str,
        idl_type: Any,
        policies: Policies,
        user_data: bytes,
        on_data: Callable[[], object],
        on_matched: Callable[[], object] | None = None,
    ) -> "Endpoint":
        """Make a reader; `hush` of the result prevents calls of `on_data`. Raises BridgeError."""
        callbacks: dict[str, Any] = {}
        if on_matched is not None:
            callbacks["on_subscription_matched"] = lambda reader, status: on_matched()
        hushed = self._listener(**callbacks)
        listener = self._listener(on_data_available=lambda reader: on_data(), **callbacks)
        made = self._make(
            self._reader_class, self._subscriber, topic, idl_type, policies, (user_data, []), listener
        )
        made.listeners = listener, hushed
        return made

    def watch(self, what: str, on_data: Callable[[], None]) -> Any:
        """Make a reader of `DcpsParticipant`, `DcpsPublication` or `DcpsSubscription`."""
        from cyclonedds import builtin

        listener = self._listener(on_data_available=lambda reader: on_data())
        return builtin.BuiltinDataReader(self.entity, getattr(builtin, f"BuiltinTopic{what}"), None, listener)

    def _make(
        self,
        kind: Any,
        parent: Any,
        topic: str,
        idl_type: Any,
        policies: Policies,
        more: tuple[bytes, list[Any]],
        listener: Any,
    ) -> "Endpoint":
        policy = self._policy
        liveliness = policy.Liveliness.ManualByTopic if policies.manual else policy.Liveliness.Automatic
        user_data, others = more
        qos = self._qos(
            policy.Reliability.Reliable(0) if policies.reliable else policy.Reliability.BestEffort,
            policy.Durability.TransientLocal if policies.transient_local else policy.Durability.Volatile,
            self._history(policies),
            policy.Deadline(policies.deadline_ns),
            liveliness(policies.lease_ns),
            policy.DataRepresentation(use_cdrv0_representation=True),
            policy.IgnoreLocal.Participant,
            policy.Userdata(user_data),
            *others,
        )
        key = topic, idl_type
        try:
            held, count = self._topics.get(key) or (self._topic_class(self.entity, topic, idl_type), 0)
            self._topics[key] = held, count + 1
            try:
                entity = kind(parent, held, qos, listener)
            except self._error:
                self._release(key)
                raise
        except self._error as error:
            raise BridgeError(
                f"DDS refuses topic '{topic}' of type {idl_type.__name__}: {raw.describe_code(error.code)}"
            ) from None
        return Endpoint(entity, lambda: self._release(key))

    def _release(self, key: tuple[str, Any]) -> None:
        held, count = self._topics[key]
        if count > 1:
            self._topics[key] = held, count - 1
        else:
            del self._topics[key]
            raw.delete(held)

    def _history(self, policies: Policies) -> Any:
        history = self._policy.History
        return history.KeepAll if policies.keep_all else history.KeepLast(policies.depth)


class Endpoint:
    """A reader or writer of this participant."""

    def __init__(self, entity: Any, release: Callable[[], None]) -> None:
        self.entity = entity
        self.guid: bytes = entity.guid.bytes
        self.listeners: tuple[Any, Any] | None = None
        """For a reader: a listener with data events, and a listener without them."""
        self._release: Callable[[], None] | None = release

    def hush(self, is_hushed: bool) -> None:
        """Turn calls of a reader's `on_data` off or on. Under load, they would take the interpreter's lock
        for each message.

        After turning them on, check once more whether there is data.
        """
        if self.listeners is not None and self._release is not None:
            raw.listen(self.entity, self.listeners[is_hushed])

    def matched_readers(self) -> list[int]:
        """Handles of the readers that are matched with this writer."""
        found: list[int] = self.entity.get_matched_subscriptions()
        return [handle % 2**64 for handle in found]

    def matched_writers(self) -> list[int]:
        """Handles of the writers that are matched with this reader."""
        found: list[int] = self.entity.get_matched_publications()
        return [handle % 2**64 for handle in found]

    def guid_of_writer(self, handle: int) -> bytes | None:
        """The GUID of a writer that is matched with this reader; None if it has gone."""
        found = self.entity.get_matched_publication_data(handle)
        return None if found is None else found.key.bytes

    def close(self) -> None:
        """End the endpoint; returns when no callback runs any more. A second call has no effect."""
        if self._release is not None:
            raw.delete(self.entity)
            self._release()
            self._release = None


def policies_of(qos: Any) -> Policies:
    """The policies of a far endpoint, as reported by discovery."""
    from cyclonedds.core import Policy

    said = {one.__scope__: one for one in qos}
    liveliness, history = said.get("Liveliness"), said.get("History")
    service = said.get("DurabilityService")
    deadline, lifespan = said.get("Deadline"), said.get("Lifespan")
    durability = said.get("Durability")
    depth = getattr(history, "depth", 1)
    if service is not None:
        depth = max(depth, getattr(service.history, "depth", 1))
    return Policies(
        reliable=said.get("Reliability") != Policy.Reliability.BestEffort,
        durability=VOLATILE if durability in (None, Policy.Durability.Volatile) else TRANSIENT_LOCAL,
        keep_all=history == Policy.History.KeepAll,
        depth=depth,
        deadline_ns=getattr(deadline, "deadline", FOREVER_NS),
        lifespan_ns=getattr(lifespan, "lifespan", FOREVER_NS),
        liveliness=MANUAL_BY_TOPIC if isinstance(liveliness, Policy.Liveliness.ManualByTopic) else AUTOMATIC,
        lease_ns=getattr(liveliness, "lease_duration", FOREVER_NS),
    )


def user_data_in(qos: Any) -> bytes:
    """USER_DATA of an endpoint or participant; empty without any."""
    for one in qos:
        if one.__scope__ == "Userdata":
            data: bytes = one.data
            return data
    return b""


def _no_domain(options: DdsOptions, uri: str) -> str:
    if uri:
        return f"cyclonedds can't open DDS domain {options.domain} as CYCLONEDDS_URI says: {uri[:200]}"
    if options.interface:
        return f"cyclonedds can't open DDS domain {options.domain} on interface '{options.interface}'"
    return (
        f"cyclonedds can't open DDS domain {options.domain}: this process has it, or its ports are all in use"
    )
