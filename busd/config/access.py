"""Users, groups and modes as the configuration names them, and as the kernel knows them.

Owns the way from names to numbers, and the contradictions between the rules and the socket. Must not know
what a rule decides: that is busd.core.access.
"""

import grp
import pwd
import stat
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from bus.errors import ConfigurationError
from bus.topic_patterns import compiled, shown
from busd.core.access import ACTIONS, AccessRule

__all__ = ["AccessTable", "SocketTable", "find_doubts"]

_EVERYBODY = "*"

_Names = str | int | tuple[str | int, ...]
_GROUP_MAY, _OTHERS_MAY = stat.S_IWGRP, stat.S_IWOTH  # connecting needs the right to write (unix(7))


class SocketTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`[socket]`: which users can reach the socket at all. Raises ConfigurationError for a bad value."""

    mode: int = 0o600
    """Mode of the socket's file; in TOML 0o660 is octal."""
    group: str | int | None = None
    """The socket's group, or None for the process's group."""

    def __post_init__(self) -> None:
        if self.mode & ~0o666 or self.mode & 0o600 != 0o600:
            raise ConfigurationError(f"socket.mode = {self.mode}: expected 0o600, 0o660 or 0o666, in octal")
        if self.group is not None:
            group_id(self.group, "socket.group")

    @property
    def gid(self) -> int | None:
        return None if self.group is None else group_id(self.group, "socket.group")


class AccessTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One `[[access]]`, as in the file; `rule` has it with numbers."""

    topics: str | tuple[str, ...]
    actions: str | tuple[str, ...]
    users: _Names = ()
    groups: _Names = ()
    allow: bool = True
    shared_memory: bool = False
    """A key of earlier versions, ignored: between users all samples use the socket."""

    def rule(self, key: str) -> AccessRule:
        """Raises ConfigurationError, naming the `key` and what is wrong, also for an unknown name."""
        users, groups = _listed(self.users), _listed(self.groups)
        if bool(users) == bool(groups):
            raise ConfigurationError(f"{key}: expected either users or groups, with one entry at least")
        for field in ("topics", "actions"):
            if not getattr(self, field):
                raise ConfigurationError(f"{key}.{field}: expected one entry at least")
        for pattern in _listed(self.topics):
            compiled(pattern, f"{key}.topics")
        names = [name for name in users if name != _EVERYBODY]
        uids = {user_id(name, f"{key}.users"): str(name) for name in names}
        return AccessRule(
            topics=_listed(self.topics),
            actions=frozenset(_action(action, f"{key}.actions") for action in _listed(self.actions)),
            uids=frozenset(uids),
            gids=frozenset(group_id(name, f"{key}.groups") for name in groups),
            is_for_all=_EVERYBODY in users,
            allow=self.allow,
            names={uid: name for uid, name in uids.items() if name != str(uid)},
            ignored=(f"{key}.shared_memory = true",) if self.shared_memory else (),
        )


def user_id(name: str | int, key: str) -> int:
    """Raises ConfigurationError if there is no such user; a number needs none."""
    return _number(name, key, "user", lambda text: pwd.getpwnam(text).pw_uid, pwd.getpwall, "pw_name")


def group_id(name: str | int, key: str) -> int:
    """Raises ConfigurationError if there is no such group; a number needs none."""
    return _number(name, key, "group", lambda text: grp.getgrnam(text).gr_gid, grp.getgrall, "gr_name")


def find_doubts(rules: Sequence[AccessRule], path: Path) -> list[str]:
    """Parts of the rules that mean nothing, or contradict the socket that now listens at `path`."""
    doubts = [
        f"{text} has no effect any more: different users only use the socket route; remove it"
        for rule in rules
        for text in rule.ignored
    ]
    return doubts + _doubts_of_the_socket(rules, path)


def _doubts_of_the_socket(rules: Sequence[AccessRule], path: Path) -> list[str]:
    try:
        if str(path).startswith("@"):  # an abstract socket: the kernel lets every user reach it
            mode, folder = 0o666, 0o755
        else:
            mode, folder = path.stat().st_mode, path.parent.stat().st_mode
    except OSError:
        return []  # it has just been removed
    has_guests = any(rule.allow for rule in rules)
    reaches = (mode & _GROUP_MAY and folder & stat.S_IXGRP) or (mode & _OTHERS_MAY and folder & stat.S_IXOTH)
    what = f"{path} (mode {stat.S_IMODE(mode):04o}, its folder {stat.S_IMODE(folder):04o})"
    if has_guests and not reaches:
        return [
            f"[[access]] has rules for other users, but they can't reach {what}: "
            "see [socket] mode and group, and the folder's mode"
        ]
    if reaches and not has_guests:
        return [f"other users can connect to {what}, but no rule of [[access]] allows them anything"]
    return []


def _listed(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _action(name: str, key: str) -> Any:
    if name in ACTIONS:
        return name
    from bus.base.suggest import did_you_mean

    hint = did_you_mean(name.lower(), ACTIONS) or f" (known: {', '.join(ACTIONS)})"
    raise ConfigurationError(f"{key}: {shown(name)} is not an action{hint}")


def _number(
    name: str | int,
    key: str,
    kind: str,
    find: Callable[[str], int],
    find_all: Callable[[], list[Any]],
    field: str,
) -> int:
    if isinstance(name, int):
        if not 0 <= name < 2**32 - 1:
            raise ConfigurationError(f"{key}: {name} is not the number of a {kind}")
        return name
    try:
        return find(name)
    except (KeyError, ValueError):
        pass
    from bus.base.suggest import did_you_mean

    hint = did_you_mean(name, [getattr(entry, field) for entry in find_all()])
    hint = "; '*' is for users" if name == _EVERYBODY else hint
    raise ConfigurationError(f"{key}: there is no {kind} {shown(name)} on this machine{hint}")
