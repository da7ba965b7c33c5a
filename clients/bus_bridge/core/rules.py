"""Decides which topics cross a bridge, in which direction, and how, from the options and busd.toml.

All names are names on this bus. A rule or pattern for a service applies to both of its topics, and for an
action to all of its services and topics: it uses the name that users know. Pure.
"""

import re
from collections.abc import Iterable
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from bus.errors import ConfigurationError
from bus.names import is_hidden_topic, request_topic, service_of_topic, validate_full_topic_name
from bus.parameters.messages import SERVICES
from bus.qos import MAX_DEPTH, QoSProfile
from bus.topic_patterns import compiled
from bus_bridge.core.qos_rule import AS_IT_IS, QosRule
from bus_bridge.engine import EndpointKind, Priority, RouteRule

__all__ = ["Crossing", "Direction", "Kind", "Rules", "TopicRule", "kind_of", "subject_of"]

Direction = Literal["both", "out", "in", "none"]
Kind = Literal["topics", "services", "actions", "parameters"]

_MOST_REMEMBERED = 10_000
_PRIVATE = frozenset(("/rosout", "/parameter_events"))
"""Topics that each bus has. They only cross if a pattern is exactly the name."""
_OF_ACTION = re.compile(r"(/.+)/_action/(?:feedback|status|send_goal|cancel_goal|get_result)")
_PARAMETER_SERVICES = frozenset(SERVICES.values())
_WILD = frozenset("*?[")


class TopicRule(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The user's settings for topics that match `pattern`: one `[[bridge.<engine>.topics]]`.

    None: another rule decides, or the default applies. The names of the fields are the keys.
    """

    pattern: str
    kind: Kind | None = None
    """The rule is only for names of this kind; None: for all."""
    direction: Direction | None = None
    """`out`: only from this bus; `in`: only to this bus; `none`: neither.

    For a service or action it names the server's side: `out` offers our servers to the far side.
    """
    depth: Annotated[int, Meta(ge=1, le=MAX_DEPTH)] | None = None
    max_rate_hz: Annotated[float, Meta(gt=0)] | None = None
    priority: Priority | None = None
    transit: bool | None = None
    far_name: str | None = None
    """The name on the far side of the topic, service or action whose name is `pattern`."""
    publisher: QosRule | None = None
    """The QoS with which publishers are shown on the other side."""
    subscription: QosRule | None = None
    """The QoS with which subscriptions are shown on the other side."""


class Crossing(msgspec.Struct, frozen=True):
    """The decision of the rules about one topic."""

    goes_out: bool
    """Whether messages of this bus go to the far side."""
    comes_in: bool
    """Whether messages of the far side come to this bus."""
    rule: RouteRule
    publisher: QosRule = AS_IT_IS
    subscription: QosRule = AS_IT_IS

    def qos_of(self, kind: EndpointKind, qos: QoSProfile) -> QoSProfile:
        """The QoS with which an endpoint is shown on the other side."""
        return (self.publisher if kind == "publisher" else self.subscription).applied(qos)


class Rules:
    """The rules of a bridge. `allow` and `deny` are patterns as in busd.toml.

    Without `allow`, all topics cross except private ones. `deny` is stronger than `allow`. If several of
    `topics` match a topic and set the same option, the last one counts.

    Raises ConfigurationError for a pattern that can't match anything, and for impossible far names.
    """

    def __init__(
        self,
        allow: Iterable[str] = (),
        deny: Iterable[str] = (),
        topics: Iterable[TopicRule] = (),
        *,
        table: str = "bridge",
    ) -> None:
        self._allow = [(one, compiled(one, "allow")) for one in allow]
        self._deny = [compiled(one, "deny") for one in deny]
        self._topics = [(one, compiled(one.pattern, f"{table}.topics.pattern")) for one in topics]
        self._known: dict[str, Crossing] = {}
        self.far_names = _far_names((one for one, _ in self._topics), f"{table}.topics.far_name")
        """Names on the far side by the names of topics, services and actions on this bus."""

    @property
    def has_transit(self) -> bool:
        """Whether some topic has `transit`: messages brought in by another bridge may go out."""
        return any(one.transit for one, _ in self._topics)

    def crossing(self, topic: str) -> Crossing:
        """The decision about `topic`, a full name."""
        known = self._known.get(topic)
        if known is None:
            if len(self._known) >= _MOST_REMEMBERED:  # names come from the far side, too
                self._known.clear()
            known = self._known[topic] = self._find(topic)
        return known

    def _find(self, topic: str) -> Crossing:
        subject, kind = subject_of(topic), kind_of(topic)
        direction: Direction = "both"
        changes: dict[str, object] = {}
        qos = {"publisher": AS_IT_IS, "subscription": AS_IT_IS}
        for one, pattern in self._topics:
            if one.kind in (None, kind) and pattern.fullmatch(subject):
                said = {name: value for name, value in _fields(one).items() if value is not None}
                direction = said.pop("direction", direction)  # type: ignore[assignment]
                for end, before in qos.items():
                    setting = said.pop(end, None)
                    if kind == "topics" and isinstance(setting, QosRule):
                        qos[end] = setting.over(before)
                changes |= said
        rule = RouteRule(**changes)  # type: ignore[arg-type]
        if not self._may_cross(subject):
            return Crossing(False, False, rule)
        ways = direction in ("both", "out"), direction in ("both", "in")
        service = service_of_topic(topic)
        if service is not None and topic == request_topic(service):
            ways = ways[1], ways[0]  # requests go to the server's side
        return Crossing(*ways, rule, qos["publisher"], qos["subscription"])

    def _may_cross(self, subject: str) -> bool:
        if any(pattern.fullmatch(subject) for pattern in self._deny):
            return False
        matching = [text for text, pattern in self._allow if pattern.fullmatch(subject)]
        if subject in _PRIVATE:
            return subject in matching
        if is_hidden_topic(subject):
            return any("/_" in text or not _WILD.intersection(text) for text in matching)
        return bool(matching) or not self._allow


def subject_of(topic: str) -> str:
    """The users' name for the owner of `topic`: an action, a service, or the topic itself."""
    name = service_of_topic(topic) or topic
    action = _OF_ACTION.fullmatch(name)
    return name if action is None else action[1]


def kind_of(topic: str) -> Kind:
    """The kind of the owner of `topic`."""
    service = service_of_topic(topic)
    if _OF_ACTION.fullmatch(service or topic):
        return "actions"
    if service is None:
        return "topics"
    return "parameters" if service.rpartition("/")[2] in _PARAMETER_SERVICES else "services"


def _fields(rule: TopicRule) -> dict[str, object]:
    found = msgspec.structs.asdict(rule)
    found |= {end: getattr(rule, end) for end in ("publisher", "subscription")}
    del found["pattern"], found["kind"], found["far_name"]
    return found


def _far_names(rules: Iterable[TopicRule], key: str) -> dict[str, str]:
    """Names on the far side by names here. Raises ConfigurationError, which begins with `key`."""
    found: dict[str, str] = {}
    for one in rules:
        if one.far_name is None:
            continue
        for name in (one.pattern, one.far_name):
            try:
                validate_full_topic_name(name)
            except ConfigurationError as error:
                what = "its pattern must be one name, without wildcards" if name is one.pattern else ""
                what = what or " ".join(line.strip() for line in str(error).splitlines()[:2])
                raise ConfigurationError(f"{key} = '{one.far_name}': {what}") from None
            if (subject := subject_of(name)) != name:
                raise ConfigurationError(
                    f"{key} = '{one.far_name}': '{name}' is a part of '{subject}'; use that name"
                )
        if one.kind is not None:
            raise ConfigurationError(f"{key} = '{one.far_name}': such a rule can't have a 'kind'")
        found[one.pattern] = one.far_name
    here: dict[str, str] = {}
    for name, far_name in found.items():
        if (other := here.setdefault(far_name, name)) != name:
            raise ConfigurationError(f"{key} = '{far_name}' is given to both '{other}' and '{name}'")
    return found
