"""`python -m chaos.bridges --kills 200 --seed 7`: two buses joined by zenoh, with faults in between.

Bridges and busds are killed and come back, bridges hang, and the cable is pulled, one after the other or
together, under streams in both directions. Invariants:

- No message comes twice or out of order: always.
- After the last fault everything flows again within five seconds, calls and goals, too.
- Each call and each goal ends with its answer or with an error, and is carried out once at most.
- In a round without kills no counter is lost with its process. Then every missing message has been counted,
  by the subscription or by one of the bridges.
"""

import asyncio
import random
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import AsyncExitStack
from importlib.util import find_spec
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

import bus
import netns
from bridged_world import Bridge, Stream, World
from chaos.calls import Calls, Doubled, goals, services
from chaos.joined import Broken, play
from conftest import SOON_S

QUALITIES = {
    "reliable": bus.QoSProfile(1000),
    "shallow": bus.QoSProfile(5),
    "sensor": bus.QoSProfile(1000, reliability="best_effort"),
    "lossless": bus.QoSProfile(history="keep_all"),
}
_HZ = 50.0
_PER_ROUND = 4
_NO_BUSD = "no busd listens on"
_AWAY_S, _BETWEEN_S = (0.0, 1.5), (0.0, 1.0)
_BACK_S = SOON_S
"""The longest time from the end of a fault until messages flow again."""


class Deed(NamedTuple):
    """A fault: its kind, its side, its duration; `kills`: it ends a process, with its counters."""

    what: str
    who: str
    away_s: float
    pause_s: float
    kills: bool


def plan(chance: random.Random, kills: int) -> Iterator[list[Deed]]:
    """Rounds of some faults each, until `kills` are done. Every third round kills no process."""
    done = number = 0
    while done < kills:
        number += 1
        gentle = number % 3 == 0
        kinds = ["pull", "down", "stop"] if gentle else ["bridge", "bridge", "busd", "pull", "down", "stop"]
        deeds = []
        for _ in range(min(_PER_ROUND, kills - done)):
            what = chance.choice(kinds)
            who = chance.choice(("robot", "laptop"))
            away_s = chance.uniform(*_AWAY_S)
            if what in ("pull", "stop") and chance.random() < 0.05:
                away_s = 13.0  # longer than zenoh's lease
            pause_s = chance.uniform(*_BETWEEN_S) * (chance.random() < 0.7)
            deeds.append(Deed(what, who, away_s, pause_s, what in ("bridge", "busd")))
        done += len(deeds)
        yield deeds


class Storms:
    """The streams and calls, and the faults on their way."""

    def __init__(self, world: World, streams: dict[str, Stream], calls: list[Calls]) -> None:
        self._world = world
        self._streams = streams
        self._calls = calls
        self.done: Counter[str] = Counter()
        self.back_s: list[float] = []
        self.missing: Counter[str] = Counter()
        self._locks: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    def lines(self) -> Iterator[str]:
        """The results."""
        yield f"faults: {', '.join(f'{what}: {count}' for what, count in sorted(self.done.items()))}"
        yield f"until all flowed again: {median(self.back_s):.2f} s, {max(self.back_s):.2f} s at most"
        for name, stream in self._streams.items():
            heard, missing = len(stream.heard), self.missing[name]
            yield f"{name}: {stream.sent} said, {heard} heard, {missing} missing on the way"
        yield from map(str, self._calls)

    async def round(self, deeds: list[Deed]) -> None:
        """Make the faults, and check the invariants. Raises Broken."""
        before = None if any(deed.kills for deed in deeds) else await self._counted()
        # Messages received after this were sent after the count, so no loss is both in the count and missing.
        await asyncio.gather(*(self._flows(stream) for stream in self._streams.values()))
        marks = {name: len(stream.heard) for name, stream in self._streams.items()}
        pending = []
        for deed in deeds:
            pending.append(asyncio.create_task(self._do(deed)))
            await asyncio.sleep(deed.pause_s)
        await asyncio.gather(*pending)
        self._mind()
        took_s = await asyncio.gather(*(self._flows(stream) for stream in self._streams.values()))
        self.back_s.append(max(took_s))
        self.done.update(deed.what for deed in deeds)
        try:
            await asyncio.gather(*(calls.flows() for calls in self._calls))
            await asyncio.gather(*(calls.settle() for calls in self._calls))
        except (AssertionError, Doubled) as error:
            raise Broken(str(error)) from None
        for name, stream in self._streams.items():
            heard = stream.heard[max(0, marks[name] - 1) :]
            for one, other in pairwise(heard):
                if other <= one:
                    raise Broken(f"{name}: after {one} came {other}")
            missing = heard[-1] - heard[0] + 1 - len(heard) if heard else 0
            self.missing[name] += missing
            if before is not None and missing:
                await self._accounts(name, missing, before[name])

    def _mind(self) -> None:
        """Restart a bridge that has ended because busd was away at its start, as systemd does."""
        for bridge in self._world.bridges:
            if bridge.process.poll() is not None and bridge.log.read_text().splitlines()[-1].startswith(
                _NO_BUSD
            ):
                bridge.restart()

    async def _accounts(self, name: str, missing: int, before: int) -> None:
        """Check that missing messages were counted. The bridges' counters in the graph are some 0.1 s old."""
        end = time.monotonic() + _BACK_S
        while (counted := (await self._counted())[name] - before) < missing:
            if time.monotonic() > end:
                raise Broken(f"{name}: {missing} are missing, {counted} are counted")
            await asyncio.sleep(0.1)

    async def _counted(self) -> dict[str, int]:
        """The number of messages counted as dropped or lost, for each stream."""
        # Not in the loop, which has to take messages meanwhile.
        told = await asyncio.gather(*(asyncio.to_thread(self._status, one) for one in self._world.bridges))
        routes = [route for status in told for route in status["routes"]]
        found = {}
        for name, stream in self._streams.items():
            here = sum(stream.subscription.statistics().dropped.values())
            there = sum(sum(one["dropped"].values()) for one in routes if one["topic"] == stream.topic)
            found[name] = here + there
        return found

    def _status(self, bridge: Bridge) -> dict[str, Any]:
        """The bridge's status, once it is on its bus again."""
        end = time.monotonic() + _BACK_S
        while True:
            try:
                return bridge.status()
            except AssertionError as error:
                if time.monotonic() > end:
                    raise Broken(
                        f"{bridge.node} of {bridge.side.name} does not say how it is: {error}"
                    ) from None

    async def _flows(self, stream: Stream) -> float:
        try:
            return await stream.flows(_BACK_S)
        except AssertionError as error:
            raise Broken(
                f"{stream.topic} does not flow {_BACK_S:g} s after the last fault: {error}"
            ) from None

    async def _do(self, deed: Deed) -> None:
        side = self._world[deed.who]
        target = {"stop": "bridge", "pull": "cable", "down": "cable"}.get(deed.what, deed.what)
        async with self._locks[target if target == "cable" else f"{target} of {deed.who}"]:
            if deed.kills:
                victim = side.bridges[0] if deed.what == "bridge" else side.daemon
                victim.kill()
                await asyncio.sleep(deed.away_s)
                victim.restart()
            else:
                cable = self._world.cable()
                happens = {"pull": cable.pulled, "down": cable.down, "stop": side.bridges[0].stopped}
                with happens[deed.what]():
                    await asyncio.sleep(deed.away_s)


async def storm(world: World, kills: int, chance: random.Random) -> None:
    """Make faults until there were `kills`. Raises Broken."""
    world.join_by_zenoh()
    sides = {"there": ("robot", "laptop"), "back": ("laptop", "robot")}
    async with AsyncExitStack() as stack:
        streams: dict[str, Stream] = {}
        calls: list[Calls] = []
        for way, names in sides.items():
            talker, listener = [
                await stack.enter_async_context(world[name].node(f"{way}_{name}")) for name in names
            ]
            for quality, profile in QUALITIES.items():
                streams[f"{way} {quality}"] = await stack.enter_async_context(
                    Stream.open(f"/{way}/{quality}", talker, listener, profile, hz=_HZ)
                )
            for kind in (services, goals):
                calls.append(
                    await stack.enter_async_context(kind(f"/{way}/{kind.__name__}", talker, listener))
                )
        for stream in streams.values():
            await stream.flows()
        storms = Storms(world, streams, calls)
        for number, deeds in enumerate(plan(chance, kills), 1):
            print(f"round {number}: {', '.join(f'{one.what} {one.who} {one.away_s:.1f} s' for one in deeds)}")
            await storms.round(deeds)
        for line in storms.lines():
            print(line)


def main() -> int:
    why_not = netns.why_not() or ("" if find_spec("zenoh") else "eclipse-zenoh is not installed")
    return play("chaos.bridges", __doc__, 200, why_not, ("robot", "laptop"), storm)


if __name__ == "__main__":
    sys.exit(main())
