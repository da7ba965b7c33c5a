"""How much each process and each user may make busd hold, and the rules for single topics.

Owns the numbers and their ranges. Must not know the source of the numbers (busd.config.file reads them) nor
how they are enforced.

Both structs are frozen and always valid. A limit "per peer" is for one process: everything that goes over
its one connection, however many nodes it has. A limit "per user" is for all processes of one user together.
"""

from collections.abc import Collection, Iterable
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta, structs

from bus.errors import ConfigurationError
from bus.process.tables import checked
from bus.qos import MAX_DEPTH, History, QoSProfile
from bus.topic_patterns import compiled
from bus.wire.layout import MAX_MESSAGE_BYTES

__all__ = ["Limits", "TopicCaps", "TopicRule", "rules_for"]

_Cap = TypeVar("_Cap", int, float)

_KiB = 1024
_MiB = 1024 * _KiB

_CONNECTION_BYTES = 256 * _KiB  # above all its read buffer
_ENDPOINT_BYTES = 5 * _KiB // 2
_MATCH_BYTES = 320

_MessageBytes = Annotated[int, Meta(ge=_KiB, le=MAX_MESSAGE_BYTES)]
_Bytes = Annotated[int, Meta(ge=_KiB, le=2**40)]
_Count = Annotated[int, Meta(ge=1, le=2**20)]
_Depth = Annotated[int, Meta(ge=1, le=MAX_DEPTH)]
_Seconds = Annotated[float, Meta(ge=0.1, le=86_400)]
_Lifespan = Annotated[float, Meta(ge=0.001, le=86_400)]


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Upper bounds of busd's resources; the defaults suit a robot's computer with 4 GiB.

    Raises ConfigurationError, naming the key, for a value of the wrong type or out of range, and for two
    values that contradict each other.
    """

    connections: _Count = 256
    """Processes that have said Hello, connected at the same time."""
    connections_per_user: _Count = 224
    """Processes of one user that have said Hello. In the long run, also how many new ones busd lets in per
    second.
    """
    nodes_per_peer: _Count = 1024
    """Nodes of one process."""
    nodes_per_user: _Count = 8192
    """Nodes of one user's processes."""
    endpoints_per_peer: _Count = 4096
    """Publishers and subscriptions of one process, over all its nodes."""
    endpoints_per_user: _Count = 16_384
    """Publishers and subscriptions of one user's processes."""
    matches_per_peer: _Count = 65_536
    """Matches that the endpoints of one process take part in."""
    matches_per_user: _Count = 262_144
    """Matches that the endpoints of one user's processes take part in."""
    topics: _Count = 16_384
    """Topics that exist at the same time, over all processes."""
    topics_per_peer: _Count = 4096
    """Topics that the endpoints of one process are on."""
    topics_per_user: _Count = 8192
    """Topics that the endpoints of one user's processes are on."""
    descriptors_per_peer: _Count = 5000
    """Descriptors that busd holds of one process: its connection, its doorbell, its publishers' rings."""
    descriptors_per_user: _Count = 20_000
    """Descriptors that busd holds of one user's processes."""
    declarations_per_s_per_peer: _Count = 1000
    """Declarations and questions of one process in a second, in the long run. At once, it may make all
    declarations that its other limits allow.
    """
    declarations_per_s_per_user: _Count = 4000
    """The same for all processes of one user together."""
    schema_bytes: _Bytes = 256 * _KiB
    """Size in bytes of one message type's schema."""
    message_bytes: _MessageBytes = 64 * _MiB
    """Size in bytes of one encoded message."""
    queued_bytes_per_peer: _Bytes = 128 * _MiB
    """Bytes of messages that wait for one process; over it, its oldest messages are dropped and counted."""
    queued_bytes_per_user: _Bytes = 512 * _MiB
    """Bytes of messages that wait for one user's processes; over it, the one with most loses its oldest."""
    control_bytes_per_peer: _Bytes = 8 * _MiB
    """Bytes of control frames that wait for one process; over it, a process that takes none is cut off."""
    control_bytes_per_user: _Bytes = 128 * _MiB
    """Bytes of control frames that wait for one user's processes; over it, the one with most is cut off."""
    history_bytes_per_peer: _Bytes = 64 * _MiB
    """Bytes of transient local history kept for the publishers of one process."""
    history_bytes_per_user: _Bytes = 256 * _MiB
    """Bytes of transient local history kept for the publishers of one user's processes."""
    depth: _Depth = 100_000
    """Largest depth, in messages, of a keep-last publisher or subscription."""
    keep_all_window_bytes: _Bytes = 4 * _MiB
    """Bytes that a keep-all publisher may be ahead of its slowest reliable subscription."""
    keep_all_window_messages: _Depth = 65_536
    """Messages that a keep-all publisher may be ahead of its slowest reliable subscription."""
    ring_bytes: _Bytes = 64 * _MiB
    """Bytes that a publisher's ring in shared memory grows to, to hold the depth; one message may need
    more.
    """
    handshake_s: _Seconds = 5.0
    """Seconds in which a new connection must have said Hello."""
    lease_s: _Seconds = 10.0
    """Seconds of silence after which nothing waits for a process any more."""
    drain_s: _Seconds = 1.0
    """Seconds that busd, when it ends, gives processes to take the data that waits for them."""

    @property
    def bytes_per_user(self) -> int:
        """Most bytes that one user's processes can make busd hold, whatever they do.

        Queued or incomplete messages, history, control frames, schemas; and an estimate of the bookkeeping.
        """
        counted = (
            2 * self.queued_bytes_per_user + self.history_bytes_per_user + 2 * self.control_bytes_per_user
        )
        return counted + sum(
            most * size
            for most, size in (
                (self.connections_per_user, _CONNECTION_BYTES),
                (self.nodes_per_user + self.endpoints_per_user, _ENDPOINT_BYTES),
                (self.matches_per_user, _MATCH_BYTES),
            )
        )

    def __post_init__(self) -> None:
        _settle("limits", self)
        self._check_room("message_bytes", "queued_bytes_per_peer")
        self._check_room("keep_all_window_bytes", "queued_bytes_per_peer")
        self._check_room("schema_bytes", "control_bytes_per_peer")
        for name in self.__struct_fields__:
            if name.endswith("_per_peer"):
                self._check_room(name, f"{name.removesuffix('_per_peer')}_per_user")

    def _check_room(self, part: str, whole: str) -> None:
        if getattr(self, part) > getattr(self, whole):
            raise ConfigurationError(
                f"limits.{part} = {getattr(self, part)} does not fit into "
                f"limits.{whole} = {getattr(self, whole)}"
            )


class TopicCaps(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Caps of one topic, within the limits; None sets no cap."""

    max_depth: _Depth | None = None
    """Depth, in messages, of keep-last endpoints; keep all has its window in the limits instead."""
    max_message_bytes: _MessageBytes | None = None
    """Size in bytes of one encoded message."""
    max_lifespan_s: _Lifespan | None = None
    """Seconds after which a message is no longer delivered, even if its publisher set no lifespan."""

    def cap(self, qos: QoSProfile) -> QoSProfile:
        """`qos` with its depth and lifespan brought down to the caps; the same object if both fit."""
        changes: dict[str, int | float] = {}
        if self.max_depth is not None and qos.history is History.KEEP_LAST and qos.depth > self.max_depth:
            changes["depth"] = self.max_depth
        if self.max_lifespan_s is not None and (qos.lifespan is None or qos.lifespan > self.max_lifespan_s):
            changes["lifespan"] = self.max_lifespan_s
        return structs.replace(qos, **changes) if changes else qos


_NO_CAPS = TopicCaps()


class TopicRule(TopicCaps, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Caps for every topic whose full name matches `pattern`.

    The syntax of patterns is in busd.core.patterns.

    Raises ConfigurationError for a pattern that no topic's name can match and for a value out of range.
    """

    pattern: str

    def __post_init__(self) -> None:
        _settle("topics", self)
        compiled(self.pattern, "topics.pattern")

    def matches(self, topic: str) -> bool:
        """Whether this rule is for `topic`, a full name."""
        return compiled(self.pattern, "topics.pattern").fullmatch(topic) is not None


def rules_for(topic: str, rules: Collection[TopicRule]) -> TopicCaps:
    """The result of all rules that match `topic`: the tightest value of each cap, in whatever order."""
    found = [rule for rule in rules if rule.matches(topic)] if rules else []
    if not found:
        return _NO_CAPS
    return TopicCaps(
        max_depth=_tightest(rule.max_depth for rule in found),
        max_message_bytes=_tightest(rule.max_message_bytes for rule in found),
        max_lifespan_s=_tightest(rule.max_lifespan_s for rule in found),
    )


def _settle(table: str, struct: msgspec.Struct) -> None:
    # msgspec only checks values that it decodes. Seconds, a float, may also be an int.
    for field in structs.fields(struct):
        value = checked(f"{table}.{field.name}", getattr(struct, field.name), field.type)
        structs.force_setattr(struct, field.name, value)


def _tightest(caps: Iterable[_Cap | None]) -> _Cap | None:
    return min((cap for cap in caps if cap is not None), default=None)
