"""`python -m chaos.ros2 --kills 30 --seed 7`: a bus and a node of rclpy, with `bus bridge ros2` in between.

Both sides call services of each other. Meanwhile the bridge, busd and the node of rclpy are killed and come
back, and the bridge and the node hang. Invariants:

- Each call of the bus ends, with an answer or an error.
- No server carries out a call twice, in either direction.
- After the last fault, calls are answered again in both directions: within the lease of a participant.
"""

import asyncio
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.util import find_spec
from typing import Any, Final

import bus
from bridged_world import Side, World
from bus.types.classes import service_class
from chaos.calls import Calls, Doubled
from chaos.joined import Broken, play
from peers.peer import Peer, ros, why_no_ros

LIST = "rcl_interfaces/srv/ListParameters"
ListParameters: Any = service_class(LIST)
_DISTRO: Final = "jazzy"
_PER_ROUND = 3
_KINDS = ("bridge", "bridge", "busd", "node", "stop bridge", "stop node")
_LEASE_S = 30.0
"""Longer than the lease of a participant of ROS 2: so long a killed one can have requests that are lost."""
_CALL_S = 1.0
"""How long rclpy waits for an answer."""


class Far:
    """The node of rclpy. It offers "/theirs", and calls "/ours" again and again."""

    def __init__(self, world: World) -> None:
        self.answered = 0
        """Calls of "/ours" that were answered."""
        self._world = world
        self._before: Counter[int] = Counter()
        self._calls = 0
        self.peer = self._make()

    @property
    def heard(self) -> Counter[int]:
        """How often each call of "/theirs" was carried out."""
        return self._before + _numbers(self.peer)

    def kill(self) -> None:
        self.peer.kill()

    def restart(self) -> None:
        self.peer.close()  # has read all that it said
        self._before += _numbers(self.peer)
        self.peer = self._make()

    async def run(self) -> None:
        """Call "/ours" until cancelled. While the node is away, calls fail."""
        while True:
            self._calls += 1
            ask = {"service": "/ours", "type_name": LIST, "depth": self._calls, "time_s": _CALL_S}
            try:
                answer = await asyncio.to_thread(self.peer.ask, "call", **ask)
            except (OSError, TimeoutError, ValueError):
                await asyncio.sleep(0.1)
                continue
            if answer != "no server":
                self.answered += len([one for one in answer if one is not None])

    def _make(self) -> Peer:
        peer = ros(_DISTRO, "ros_node", self._world["robot"].machine, domain=self._world.domain)
        peer.ask("offer", service="/theirs", type_name=LIST, result={"names": ["a"]})
        return peer


def _numbers(peer: Peer) -> Counter[int]:
    return Counter(one["depth"] for one in peer.heard["/theirs"])


@asynccontextmanager
async def calls_to(far: Far, node: bus.Node) -> AsyncIterator[Calls]:
    """Calls of "/theirs". What was carried out twice is the far side's count."""

    async def ask(number: int) -> int:
        await asking.call(ListParameters.Request(depth=number))
        return number

    asking = await node.create_client(ListParameters, "/theirs")
    await asking.wait_for_service()
    calls = Calls("calls of the bus", ask)
    calls.soon_s = _LEASE_S
    async with calls.running():
        yield calls


class Storms:
    """Faults, and the checks after them."""

    def __init__(self, side: Side, far: Far, calls: Calls, taken: Counter[int]) -> None:
        self._side = side
        self._far = far
        self._calls = calls
        self._taken = taken
        self.done: Counter[str] = Counter()
        self.longest_s = 0.0

    async def round(self, kinds: list[str], away_s: list[float]) -> None:
        """Make faults one after the other. Raises Broken."""
        for kind, time_s in zip(kinds, away_s, strict=True):
            await self._do(kind, time_s)
            self.done[kind] += 1
        self._mind()
        began_s, answered = time.monotonic(), self._far.answered
        try:
            await self._calls.flows()
            while self._far.answered == answered:
                if time.monotonic() - began_s > _LEASE_S:
                    raise Broken("no call of ROS 2 is answered any more")
                await asyncio.sleep(0.05)
            self.longest_s = max(self.longest_s, time.monotonic() - began_s)
            self._calls.done = self._far.heard
            await self._calls.settle()
        except (AssertionError, Doubled) as error:
            raise Broken(str(error)) from None
        if twice := [number for number, count in self._taken.items() if count > 1]:
            raise Broken(f"calls of ROS 2 that were carried out twice: {twice[:10]}")

    async def _do(self, kind: str, away_s: float) -> None:
        bridge = self._side.bridges[0]
        if kind == "stop bridge":
            with bridge.stopped():
                await asyncio.sleep(away_s)
        elif kind == "stop node":
            self._far.peer.process.send_signal(signal.SIGSTOP)
            await asyncio.sleep(away_s)
            self._far.peer.process.send_signal(signal.SIGCONT)
        else:
            victim: Any = {"bridge": bridge, "busd": self._side.daemon, "node": self._far}[kind]
            victim.kill()
            await asyncio.sleep(away_s)
            await asyncio.to_thread(victim.restart)

    def _mind(self) -> None:
        """Restart a bridge that has ended because busd was away at its start, as systemd does."""
        bridge = self._side.bridges[0]
        if bridge.process.poll() is not None:
            bridge.restart()


async def storm(world: World, kills: int, chance: random.Random) -> None:
    """Make faults until there were `kills`. Raises Broken."""
    side = world["robot"]
    side.bridge("ros2", "--domain-id", str(world.domain))
    taken: Counter[int] = Counter()

    def answer(request: Any) -> Any:
        taken[request.depth] += 1
        return ListParameters.Response()

    far = Far(world)
    async with side.node("robot") as node:
        await node.create_service(ListParameters, "/ours", answer)
        task = asyncio.create_task(far.run())
        try:
            async with calls_to(far, node) as calls:
                storms = Storms(side, far, calls, taken)
                while sum(storms.done.values()) < kills:
                    kinds = chance.choices(_KINDS, k=_PER_ROUND)
                    away_s = [chance.uniform(0.0, 1.5) for _ in kinds]
                    print(
                        "round:", ", ".join(f"{one} {s:.1f} s" for one, s in zip(kinds, away_s, strict=True))
                    )
                    await storms.round(kinds, away_s)
                print(f"faults: {dict(storms.done)}")
                print(f"until both sides had answers: {storms.longest_s:.1f} s at most")
                print(f"{calls}; carried out there {sum(far.heard.values())}")
                print(f"calls of ROS 2: {far.answered} answered, carried out here {sum(taken.values())}")
        finally:
            task.cancel()
            far.kill()
            await asyncio.gather(task, return_exceptions=True)
            far.peer.close()


def main() -> int:
    why_not = why_no_ros(_DISTRO) or ("" if find_spec("cyclonedds") else "cyclonedds is not installed")
    return play("chaos.ros2", __doc__, 30, why_not, ("robot",), storm)


if __name__ == "__main__":
    sys.exit(main())
