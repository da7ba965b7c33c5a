"""The QoS with which the rules show an endpoint on the other side, instead of its own. Pure."""

from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from bus.qos import MAX_DEPTH, Durability, History, QoSProfile, Reliability

__all__ = ["AS_IT_IS", "QosRule"]

_MOST_WAITING: Final = 1000
"""The depth of a lossless publisher's copy that is not lossless."""


class QosRule(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The user's settings for publishers, or for subscriptions. None: as the endpoint has it."""

    reliability: Literal["reliable", "best_effort"] | None = None
    durability: Literal["volatile", "transient_local"] | None = None
    depth: Annotated[int, Meta(ge=1, le=MAX_DEPTH)] | None = None
    """The history is keep last, with this depth."""

    def over(self, other: "QosRule") -> "QosRule":
        """These settings. One that is None has the value of `other`."""
        return QosRule(**{**_set(other), **_set(self)})

    def applied(self, qos: QoSProfile) -> QoSProfile:
        """The profile with these settings.

        It is not lossless unless `qos` is: no endpoint waits for messages because of a rule.
        """
        if self == AS_IT_IS:
            return qos
        changes: dict[str, Any] = {}
        if self.reliability is not None:
            changes["reliability"] = Reliability(self.reliability)
        if self.durability is not None:
            changes["durability"] = Durability(self.durability)
        if self.depth is not None:
            changes |= {"history": History.KEEP_LAST, "depth": self.depth}
        made = msgspec.structs.replace(qos, **changes)
        if made.is_lossless and not qos.is_lossless:
            made = msgspec.structs.replace(made, history=History.KEEP_LAST, depth=_MOST_WAITING)
        return made


AS_IT_IS: Final = QosRule()


def _set(rule: QosRule) -> dict[str, Any]:
    return {key: value for key, value in msgspec.structs.asdict(rule).items() if value is not None}
