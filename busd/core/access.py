"""Which users may do what on which topics.

Owns the rules, their order, and the default if no rule applies. Must not know names of users and groups
(busd.config.access finds their numbers), nor the effects of a denial.

Users are numbers, as the kernel gives them for the process at the other end of a connection. The daemon's own
user and root may do everything: they could change the daemon itself. So may a user that the system does not
name (uid -1): there, only the socket's mode decides.
"""

from typing import Literal, NamedTuple, TypeAlias

import msgspec

from bus.topic_patterns import compiled

__all__ = ["ACTIONS", "Access", "AccessRule", "Action", "Subject", "Verdict"]

Action: TypeAlias = Literal["publish", "subscribe", "observe"]
ACTIONS: tuple[Action, ...] = ("publish", "subscribe", "observe")

_ROOT = 0
_UNKNOWN = -1
_MOST_REMEMBERED = 16_384


class Subject(NamedTuple):
    """A process, as rules see it. `gids` are all of its groups, or None if they are unknown."""

    uid: int
    gids: frozenset[int] | None = frozenset()


class Verdict(NamedTuple):
    """`rule` is the place in the file, from 1, of the rule that decided; 0: none did."""

    is_allowed: bool
    rule: int = 0


_FREE = Verdict(is_allowed=True)
_SILENCE = Verdict(is_allowed=False)


class AccessRule(msgspec.Struct, frozen=True, kw_only=True):
    """Allows, or denies, `actions` on topics. One of `uids`, `gids` and `is_for_all` says to which users.

    Raises ConfigurationError for a pattern that can never match.
    """

    topics: tuple[str, ...]
    actions: frozenset[Action]
    uids: frozenset[int] = frozenset()
    gids: frozenset[int] = frozenset()
    is_for_all: bool = False
    allow: bool = True
    names: dict[int, str] = {}
    """Names of the users, as far as the file has them."""
    ignored: tuple[str, ...] = ()
    """Keys in the rule that mean nothing any more."""

    def __post_init__(self) -> None:
        for pattern in self.topics:
            compiled(pattern, "access.topics")

    def is_for(self, who: Subject) -> bool:
        """Whether this rule applies to `who`. Unknown groups count as groups that are denied."""
        if self.is_for_all or who.uid in self.uids:
            return True
        if who.gids is None:
            return bool(self.gids) and not self.allow
        return not self.gids.isdisjoint(who.gids)

    def speaks_of(self, action: Action, topic: str) -> bool:
        return action in self.actions and any(
            compiled(pattern, "access.topics").fullmatch(topic) for pattern in self.topics
        )


class Access:
    """The rules in the order of the file, for a daemon of the user `own_uid`: the first that matches decides.

    If no rule applies, the action is denied.
    """

    def __init__(self, own_uid: int = _ROOT, rules: tuple[AccessRule, ...] = ()) -> None:
        self.rules = rules
        self._names = {uid: name for rule in rules for uid, name in rule.names.items()}
        self._own_uid = own_uid
        self._free = {own_uid, _ROOT, _UNKNOWN}
        self._remembered: dict[tuple[Subject, Action, str], Verdict] = {}
        self.looks = 0
        """Number of rules checked so far. A question that was asked before checks no rule."""

    def is_free(self, uid: int) -> bool:
        """Whether no rule applies to that user."""
        return uid in self._free

    def may_connect(self, who: Subject) -> bool:
        """Whether any rule allows `who` anything."""
        return self.is_free(who.uid) or any(rule.allow and rule.is_for(who) for rule in self.rules)

    def name(self, uid: int) -> str:
        """A user, in words."""
        name = self._names.get(uid)
        return f"user {uid}" if name is None else f"user {name} (uid {uid})"

    def why_turned_away(self, who: Subject) -> str:
        """The text for a user that may not connect."""
        groups = "" if who.gids is None else f", groups {', '.join(map(str, sorted(who.gids)))}"
        return (
            f"user {who.uid}{groups} may not use the busd of user {self._own_uid}: no rule of [[access]] "
            f"allows anything; add one to its busd.toml, with users = [{who.uid}]"
        )

    def why_not(self, who: Subject, action: Action, topic: str) -> str:
        """The text of a denial."""
        number = self.decide(who, action, topic).rule
        if number:
            reason = f"rule {number} of [[access]] denies it"
        elif self.rules:
            reason = "no rule of [[access]] in busd.toml allows it"
        else:
            reason = "without [[access]] in busd.toml only busd's own user and root may"
        what = "subscribe to" if action == "subscribe" else f"{action} on"
        return f"{self.name(who.uid)} may not {what} '{topic}': {reason}"

    def decide(self, who: Subject, action: Action, topic: str) -> Verdict:
        """Whether `who` may do that on `topic`, a full name."""
        if who.uid in self._free:
            return _FREE
        asked = who, action, topic
        verdict = self._remembered.get(asked)
        if verdict is None:
            if len(self._remembered) >= _MOST_REMEMBERED:
                self._remembered.clear()
            verdict = self._remembered[asked] = self._decide(who, action, topic)
        return verdict

    def _decide(self, who: Subject, action: Action, topic: str) -> Verdict:
        for number, rule in enumerate(self.rules, 1):
            self.looks += 1
            if rule.is_for(who) and rule.speaks_of(action, topic):
                return Verdict(rule.allow, number)
        return _SILENCE
