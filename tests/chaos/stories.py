"""Planned events in a storm, in addition to random ones: deeds that only have a meaning together.

Pure, as `plan` is. The actors of a story belong to it alone: random events do not affect them.
"""

import random
from collections.abc import Callable, Iterator, Sequence

from msgspec.structs import replace

from chaos.deeds import Cut, Doze, Enter, Kill, Leave, Resume, Script
from chaos.roles import Ear, Quality, Role, Talker

CROWD, FAREWELL, CGROUP = "crowd", "farewell", "cgroup"
STORIES = (CROWD, FAREWELL, CGROUP)

_KIB, _MIB = 1 << 10, 1 << 20
_EACH = 50
DOZERS = ("dozer", "dreamer")
"""Listeners that fall asleep, by socket and by shared memory."""

_HEARD = "/farewell"


class Stories:
    """The stories of one run. `number` returns a new number for each endpoint."""

    def __init__(self, seed: int, told: frozenset[str], number: Callable[[], int]) -> None:
        self._chance = random.Random(~seed)
        self._told = told
        self._number = number
        self._roles = 0

    def cast(self) -> list[Role]:
        """Actors that live through the whole run."""
        if FAREWELL not in self._told:
            return []
        depths = (1000, 20, 1)
        return [
            Role(
                name,
                tuple(Ear(self._number(), _HEARD, Quality(depth)) for depth in depths),
                by_socket=name == DOZERS[0],
                is_fragile=True,
            )
            for name in DOZERS
        ]

    def script(self, time_s: float, *, spares_broker: bool) -> Script:
        """Deeds for a storm of `time_s` seconds."""
        script: Script = []
        if CROWD in self._told and not spares_broker:
            script += self._crowd(time_s)
        if FAREWELL in self._told and spares_broker:
            script += self._farewell()
        if CGROUP in self._told:
            script += [(0.3, Enter(self._confined()))]
        return script

    def _crowd(self, time_s: float) -> Iterator[tuple[float, Enter | Kill]]:
        """Thousands of matches of one process come, are killed, and come back."""
        first = self._role("crowd", self._many())
        killed_s = self._chance.uniform(0.3, 0.6) * time_s
        yield 0.1, Enter(first)
        yield killed_s, Kill(first.name)
        yield killed_s + self._chance.choice((0.0, 0.3)), Enter(self._role("crowd", self._many()))

    def _farewell(self) -> Iterator[tuple[float, Enter | Doze | Leave | Cut | Resume]]:
        """Publishers leave in order while their subscriptions sleep, longer than their lease.

        When these wake up, they may be cut off: their connection ends, and with it the data that waits in it.
        """
        chance = self._chance
        leaving = [self._role("leaver", self._leavers(), by_socket=by_socket) for by_socket in (True, False)]
        for role in leaving:
            yield 0.0, Enter(role)
        for name in DOZERS:
            yield 0.5, Doze(name)
        for role in leaving:
            yield chance.uniform(0.6, 1.5), Leave(role.name)
        if chance.random() < 0.5:
            for name in DOZERS:
                yield 2.5, Cut(name, chance.choice((1, 100, 10_000)), chance.getrandbits(32))
                yield 2.6, Resume(name)

    def _confined(self) -> Role:
        """A publisher in a memory cgroup that is too small for its ring, and a subscription that reads it."""
        topic, limit_bytes = "/confined", self._chance.randint(32, 64) * _MIB
        talker = Talker(self._number(), topic, Quality(100), (64 * _KIB, _MIB), 3, 0.02)
        role = self._role("confined", [talker, Ear(self._number(), topic, Quality(5))], by_socket=False)
        return replace(role, cgroup_bytes=limit_bytes)

    def _leavers(self) -> list[Talker]:
        return [
            Talker(self._number(), _HEARD, Quality(depth), (8, 4 * _KIB), burst, 0.02)
            for depth, burst in ((1000, 20), (5, 10))
        ]

    def _many(self) -> list[Talker | Ear]:
        quality = Quality(10)
        found: list[Talker | Ear] = []
        for _ in range(_EACH):
            found.append(Talker(self._number(), "/crowd", quality, (8, 64), 1, 1.0))
            found.append(Ear(self._number(), "/crowd", quality))
        return found

    def _role(self, kind: str, endpoints: Sequence[Talker | Ear], *, by_socket: bool | None = None) -> Role:
        self._roles += 1
        if by_socket is None:
            by_socket = self._chance.random() < 0.5
        return Role(f"{kind}{self._roles}", tuple(endpoints), by_socket=by_socket)
