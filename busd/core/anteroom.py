"""Places of connections that are not let in yet: the next one to lose its place, and the next one to enter.

A connection has a place from its accept until it is let in: first silent, then with its Hello said. The
number of places is fixed. If more connections come, the user with most places loses one, in its process with
most places: the place of the connection that has been silent longest. So a storm displaces itself, and a
program that comes meanwhile stays.
"""

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

__all__ = ["MOST_WAITING", "Anteroom"]

MOST_WAITING = 128

K = TypeVar("K")


@dataclass(slots=True, eq=False)
class _Process(Generic[K]):
    """The places of one process, in the order of their coming; and their user."""

    user: "_User[K]"
    silent: dict[K, None] = field(default_factory=dict)
    heard: dict[K, None] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.silent) + len(self.heard)


@dataclass(slots=True, eq=False)
class _User(Generic[K]):
    uid: int
    places: int = 0
    processes: dict[Hashable, _Process[K]] = field(default_factory=dict)
    heard: dict[K, int] = field(default_factory=dict)
    """Connections that have said Hello, in that order, and when, in ns."""


class Anteroom(Generic[K]):
    """`places`: their number. A connection is whatever the caller takes as its key."""

    def __init__(self, places: int = MOST_WAITING) -> None:
        self._places = places
        self._silent: dict[K, int] = {}  # since when
        self._owners: dict[K, tuple[_Process[K], Hashable]] = {}
        self._users: dict[int, _User[K]] = {}

    def __len__(self) -> int:
        return len(self._owners)

    @property
    def is_overfull(self) -> bool:
        """Whether there are more connections than places."""
        return len(self._owners) > self._places

    def enter(self, now_ns: int, key: K, uid: int, owner: Hashable) -> None:
        """A connection has come and is silent; `owner` is the key of its process."""
        user = self._users.get(uid)
        if user is None:
            user = self._users[uid] = _User(uid)
        process = user.processes.get(owner)
        if process is None:
            process = user.processes[owner] = _Process(user)
        user.places += 1
        process.silent[key] = None
        self._silent[key] = now_ns
        self._owners[key] = process, owner

    def on_hello(self, now_ns: int, key: K) -> None:
        """The Hello of a connection was heard; from now on it waits for its user's turn."""
        process, _ = self._owners[key]
        del process.silent[key], self._silent[key]
        process.heard[key] = None
        process.user.heard[key] = now_ns

    def leave(self, key: K) -> None:
        """A connection was let in, turned away, or has gone."""
        process, owner = self._owners.pop(key)
        user = process.user
        self._silent.pop(key, None)
        user.heard.pop(key, None)
        process.silent.pop(key, None)
        process.heard.pop(key, None)
        user.places -= 1
        if not process:
            del user.processes[owner]
        if not user.places:
            del self._users[user.uid]

    def first_to_lose(self) -> K:
        """The connection that is the first to lose its place. There must be one."""
        user = max(self._users.values(), key=lambda one: one.places)
        process = max(user.processes.values(), key=lambda one: (len(one), bool(one.silent)))
        return next(iter(process.silent or process.heard))

    def silent(self) -> tuple[K, int] | None:
        """The connection that has been silent longest, and since when; None if no connection is silent."""
        return next(iter(self._silent.items()), None)

    def users_waiting(self) -> list[int]:
        """The users of connections that have said Hello."""
        return [user.uid for user in self._users.values() if user.heard]

    def first_waiting(self, uid: int) -> tuple[K, int] | None:
        """The connection of a user that said Hello first, and when; None if no connection waits."""
        user = self._users.get(uid)
        return None if user is None else next(iter(user.heard.items()), None)
