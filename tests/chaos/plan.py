"""The times of all events: the actors, and the faults of each storm, all from one seed.

Pure: the same seed gives the same plan. The result depends on the scheduler.
"""

import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from msgspec.structs import replace

from chaos.deeds import (
    LEASE_S,
    Cut,
    Deed,
    Enter,
    Kill,
    KillBroker,
    Leave,
    Nap,
    Remake,
    RestartBroker,
    Resume,
    ResumeBroker,
    Script,
    StartBroker,
    Stop,
    StopBroker,
)
from chaos.roles import Ear, Quality, Role, Talker
from chaos.stories import DOZERS, STORIES, Stories

LOSSLESS = Quality()
_KIB, _MIB = 1 << 10, 1 << 20


@dataclass
class _Topic:
    """A topic and its traffic: `requests` are the possible QoS of its subscriptions."""

    name: str
    offers: Callable[[random.Random], Quality]
    requests: Callable[[random.Random], Quality]
    sizes: tuple[int, int] = (8, 4 * _KIB)
    burst: int = 20
    pause_s: float = 0.02


def _depth(chance: random.Random, most: int = 1000) -> int:
    return int(most ** chance.random())


_TOPICS = (
    _Topic("/stream", lambda chance: LOSSLESS, lambda chance: LOSSLESS),
    _Topic("/bulk", lambda chance: LOSSLESS, lambda chance: LOSSLESS, (8, _MIB), 3, 0.1),
    _Topic(
        "/mixed",
        lambda chance: Quality(chance.choice((0, _depth(chance)))),
        lambda chance: Quality(chance.choice((0, _depth(chance))), chance.random() < 0.7),
    ),
    _Topic(
        "/sensor",
        lambda chance: Quality(_depth(chance), is_reliable=chance.random() < 0.5),
        lambda chance: Quality(_depth(chance), is_reliable=False),
        (8, 64 * _KIB),
    ),
    _Topic(
        "/state",
        lambda chance: Quality(_depth(chance, 200), is_durable=True),
        lambda chance: Quality(_depth(chance), is_durable=chance.random() < 0.7),
        (8, 16 * _KIB),
        5,
    ),
    _Topic(
        "/brief",
        lambda chance: Quality(_depth(chance), lifespan_s=chance.uniform(0.01, 0.3)),
        lambda chance: Quality(_depth(chance)),
    ),
    _Topic(
        "/huge",
        lambda chance: Quality(chance.randint(1, 3)),
        lambda chance: Quality(chance.randint(1, 3)),
        (64 * _KIB, 4 * _MIB),
        1,
        0.4,
    ),
)
TOPICS = tuple(topic.name for topic in _TOPICS)


@dataclass
class Plan:
    """`cast` lives through the whole run. `storm` writes the events of the next storm."""

    seed: int
    stories: frozenset[str] = frozenset(STORIES)
    cast: list[Role] = field(init=False)

    def __post_init__(self) -> None:
        self._chance = random.Random(self.seed)
        self._numbers = 0
        self._guests = 0
        self._fragile: set[str] = set()
        self._limited: set[str] = set()
        self.cast = [
            self._role("shared", self._one_of_each()),
            self._role("sockets", self._one_of_each(), by_socket=True),
            self._role("fragile", self._some(6), is_fragile=True),
            self._role("frail", self._some(6), is_fragile=True, by_socket=True),
            self._role("loops", self._some(6), loop="asyncio"),
        ]
        self._stories = Stories(self.seed, self.stories, self._next)
        self.cast += self._stories.cast()

    def storm(self, time_s: float, pace_s: float = 0.12, *, spares_broker: bool = False) -> Script:
        """About one deed each `pace_s`; new actors may be alive at its end or not, and so may busd.

        `spares_broker`: busd is stopped at most, and no connection is cut.
        """
        script: Script = [(0.0, Enter(role)) for role in self._guests_at_once(3)]
        guests = [deed.role.name for _, deed in script if isinstance(deed, Enter)]
        busy_until: dict[str, float] = {}
        at_s = 0.0
        while (at_s := at_s + self._chance.expovariate(1 / pace_s)) < time_s:
            free = [name for name in self._names(guests) if busy_until.get(name, 0) <= at_s]
            broker_is_free = busy_until.get("", 0) <= at_s
            for later_s, deed in self._deeds(free, guests, broker_is_free=broker_is_free):
                if spares_broker and isinstance(deed, Cut | KillBroker | StartBroker | RestartBroker):
                    continue
                script.append((at_s + later_s, deed))
                name = getattr(deed, "name", "" if "Broker" in type(deed).__name__ else None)
                if name is not None:
                    busy_until[name] = max(busy_until.get(name, 0), at_s + later_s)
        script += self._stories.script(time_s, spares_broker=spares_broker)
        return sorted(script, key=lambda pair: pair[0])

    def visitor(self) -> Role:
        """An actor that comes late, at a quiet moment, and subscribes to all topics with a history."""
        depths = (1, self._chance.randint(2, 100), 1000, 0)
        ears = [self._ear("/state", Quality(depth, is_durable=True)) for depth in depths]
        ears += [self._ear(topic, LOSSLESS) for topic in ("/stream", "/state")]
        return self._role(
            f"visitor{self._next()}", ears, by_socket=self._chance.random() < 0.5, is_fragile=False
        )

    # --- inside

    def _deeds(
        self, free: list[str], guests: list[str], *, broker_is_free: bool
    ) -> Iterator[tuple[float, Deed]]:
        chance = self._chance
        name = chance.choice(free) if free else ""
        match chance.choices(
            ("kill", "leave", "enter", "stop", "nap", "remake", "cut", "broker"), (3, 2, 3, 4, 2, 3, 3, 1.5)
        )[0]:
            case "kill" if name in guests:
                guests.remove(name)
                yield 0.0, Kill(name)
            case "leave" if name in guests and name not in self._limited:
                guests.remove(name)
                yield 0.0, Leave(name)
            case "enter" if len(guests) < 6:
                (guest,) = self._guests_at_once(1)
                guests.append(guest.name)
                yield 0.0, Enter(guest)
            case "stop" if name:
                yield 0.0, Stop(name)
                yield self._while(), Resume(name)
            case "nap" if name:
                time_s = self._while()
                yield 0.0, Nap(name, time_s)
            case "remake" if name and (role := self._of_cast(name)) is not None:
                at = chance.randrange(len(role.endpoints))
                old = role.endpoints[at]
                new = replace(old, number=self._next())
                endpoints = (*role.endpoints[:at], new, *role.endpoints[at + 1 :])
                self.cast[self.cast.index(role)] = replace(role, endpoints=endpoints)
                yield 0.0, Remake(name, old.number, new)
            case "cut":
                name = chance.choice(["fragile", "frail", *(one for one in guests if one in self._fragile)])
                yield 0.0, Cut(name, int(30_000 ** chance.random()), chance.getrandbits(32))
            case "broker" if broker_is_free:
                match chance.choices(("kill", "restart", "stop"), (3, 1, 2))[0]:
                    case "kill":
                        yield 0.0, KillBroker()
                        yield chance.choice((0.0, chance.uniform(0, 1.5))), StartBroker()
                    case "restart":
                        yield 0.0, RestartBroker()
                    case _:
                        yield 0.0, StopBroker()
                        yield chance.uniform(0.01, 1.0), ResumeBroker()

    def _while(self) -> float:
        """Mostly a moment, sometimes longer than a lease."""
        chance = self._chance
        return chance.uniform(LEASE_S, 1.5 * LEASE_S) if chance.random() < 0.1 else chance.expovariate(3)

    def _names(self, guests: list[str]) -> list[str]:
        return [*(role.name for role in self.cast if role.name not in DOZERS), *guests]

    def _of_cast(self, name: str) -> Role | None:
        return next((role for role in self.cast if role.name == name), None)

    def _guests_at_once(self, number: int) -> list[Role]:
        roles = []
        for _ in range(number):
            chance = self._chance
            self._guests += 1
            files, memory_bytes = chance.choices(
                ((0, 0), (chance.randint(4, 16), 0), (0, chance.randint(8, 64) * _MIB)), (6, 1, 1)
            )[0]
            role = self._role(
                f"guest{self._guests}",
                self._some(chance.randint(1, 5)),
                by_socket=chance.random() < 0.4,
                is_fragile=chance.random() < 0.3,
                loop=chance.choice(("asyncio", "uvloop")),
            )
            if files or memory_bytes:
                self._limited.add(role.name)
            roles.append(replace(role, files=files, memory_bytes=memory_bytes))
        return roles

    def _role(
        self,
        name: str,
        endpoints: Sequence[Talker | Ear],
        *,
        by_socket: bool = False,
        is_fragile: bool = False,
        loop: str = "uvloop",
    ) -> Role:
        if is_fragile:
            self._fragile.add(name)
        return Role(name, tuple(endpoints), by_socket=by_socket, is_fragile=is_fragile, loop=loop)

    def _one_of_each(self) -> list[Talker | Ear]:
        found: list[Talker | Ear] = []
        for topic in _TOPICS:
            found += [self._talker(topic), self._ear(topic.name, topic.requests(self._chance))]
        return found

    def _some(self, number: int) -> list[Talker | Ear]:
        found: list[Talker | Ear] = []
        for _ in range(number):
            topic = self._chance.choice(_TOPICS)
            is_talker = self._chance.random() < 0.4
            found.append(
                self._talker(topic) if is_talker else self._ear(topic.name, topic.requests(self._chance))
            )
        return found

    def _talker(self, topic: _Topic) -> Talker:
        offer = topic.offers(self._chance)
        return Talker(self._next(), topic.name, offer, topic.sizes, topic.burst, topic.pause_s)

    def _ear(self, topic: str, request: Quality) -> Ear:
        chance = self._chance
        return Ear(self._next(), topic, request, chance.random() < 0.6, chance.random() < 0.4)

    def _next(self) -> int:
        self._numbers += 1
        return self._numbers
