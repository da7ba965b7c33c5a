"""`python -m chaos.ros2 --kills 30 --seed 7`: a bus and a node of rclpy, with `bus bridge ros2` in between.

Both sides call services of each other, and send goals to actions. Meanwhile the bridge, busd and the node of
rclpy are killed and come back, and the bridge and the node hang. The new node is of another distribution. The
seed chooses the carrier of topics, and so of feedback. Invariants:

- Each call and each goal of the bus ends, with an answer or an error.
- No server carries out a call or a goal twice, in either direction.
- After the last fault, both are answered again in both directions: within the lease of a participant.
"""

import asyncio
import os
import random
import signal
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path
from typing import Any, Final, get_args

import bus
from bridged_world import Side, World
from bus.types.classes import service_class
from bus_actions import ActionClient, ActionServer, find_action
from chaos.calls import Calls, Doubled
from chaos.joined import Broken, play
from peers.peer import Distro, Peer, ros, why_no_ros

LIST = "rcl_interfaces/srv/ListParameters"
ListParameters: Any = service_class(LIST)
FIBONACCI = "test_msgs/action/Fibonacci"
"""The action that has a package for rclpy."""
SHARE = Path(__file__).parents[1] / "differential/share"
_DISTROS: Final = [one for one in get_args(Distro) if not why_no_ros(one, "test_msgs")]
_PER_ROUND = 3
_KINDS = ("bridge", "bridge", "busd", "node", "stop bridge", "stop node")
_LEASE_S = 30.0
"""Longer than the lease of a participant of ROS 2: so long a killed one can have requests that are lost."""
_CALL_S = 1.0
"""How long rclpy waits for an answer."""


class Far:
    """The node of rclpy. It offers "/theirs" and "/their_goals", and calls "/ours" and "/our_goals" again and
    again."""

    def __init__(self, world: World) -> None:
        self.answered: Counter[str] = Counter({"/ours": 0, "/our_goals": 0})
        """How many calls and goals were answered."""
        self._world = world
        self._before: dict[str, Counter[int]] = {"/theirs": Counter(), "/their_goals": Counter()}
        self._calls = 0
        self._distros = cycle(_DISTROS)
        self.peer = self._make()

    def heard(self, name: str) -> Counter[int]:
        """How often each call of "/theirs", or each goal of "/their_goals", was carried out."""
        return self._before[name] + _numbers(self.peer, name)

    def kill(self) -> None:
        self.peer.kill()

    def restart(self) -> None:
        self.peer.close()  # now all its output has been read
        for name, before in self._before.items():
            before.update(_numbers(self.peer, name))
        self.peer = self._make()

    async def run(self) -> None:
        """Call "/ours" and "/our_goals" until cancelled. While the node is away, calls fail."""
        while True:
            self._calls += 1
            call = {"service": "/ours", "type_name": LIST, "depth": self._calls}
            goal = {"action": "/our_goals", "type_name": FIBONACCI, "order": self._calls}
            try:
                answer = await asyncio.to_thread(self.peer.ask, "call", **call, time_s=_CALL_S)
                self.answered["/ours"] += answer not in ("no server", [None])
                answer = await asyncio.to_thread(self.peer.ask, "send_goal", **goal, time_s=_CALL_S)
                self.answered["/our_goals"] += not isinstance(answer, str)
            except (OSError, TimeoutError, ValueError):
                await asyncio.sleep(0.1)

    def _make(self) -> Peer:
        distro = next(self._distros)
        peer = ros(distro, "ros_node", self._world["robot"].machine, domain=self._world.domain)
        peer.ask("offer", service="/theirs", type_name=LIST, result={"names": ["a"]})
        peer.ask("serve_action", action="/their_goals", type_name=FIBONACCI)
        return peer


def _numbers(peer: Peer, name: str) -> Counter[int]:
    heard: list[Any] = peer.heard[name]
    return Counter(one["depth"] if isinstance(one, dict) else one for one in heard)


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


@asynccontextmanager
async def goals_to(far: Far, node: bus.Node) -> AsyncIterator[Calls]:
    """Goals of "/their_goals", as `calls_to`. The result of a goal is as long as its number."""
    fibonacci = find_action(FIBONACCI)

    async def ask(number: int) -> int:
        goal = await asking.send_goal(fibonacci.Goal(order=number))
        return len((await goal.result()).sequence)

    async with ActionClient(node, fibonacci, "/their_goals") as asking:
        await asking.wait_for_server()
        goals = Calls("goals of the bus", ask)
        goals.soon_s = _LEASE_S
        async with goals.running():
            yield goals


class Storms:
    """Faults, and the checks after them. `calls`: those of the bus, by name; `taken`: those of ROS 2 here."""

    def __init__(self, side: Side, far: Far, calls: dict[str, Calls], taken: dict[str, Counter[int]]) -> None:
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
        began_s, answered = time.monotonic(), self._far.answered.copy()
        try:
            await asyncio.gather(*(calls.flows() for calls in self._calls.values()))
            while waiting := [name for name, count in self._far.answered.items() if count == answered[name]]:
                if time.monotonic() - began_s > _LEASE_S:
                    raise Broken(f"no call of ROS 2 is answered any more: {waiting}")
                await asyncio.sleep(0.05)
            self.longest_s = max(self.longest_s, time.monotonic() - began_s)
            for name, calls in self._calls.items():
                calls.done = self._far.heard(name)
                await calls.settle()
        except (AssertionError, Doubled) as error:
            raise Broken(str(error)) from None
        for name, taken in self._taken.items():
            if twice := [number for number, count in taken.items() if count > 1]:
                raise Broken(f"calls of ROS 2 on {name} that were carried out twice: {twice[:10]}")

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
    side, fibonacci = world["robot"], find_action(FIBONACCI)
    carrier = chance.choice(["cyclonedds", "rtps"] if find_spec("cyclonedds") else ["rtps"])
    print(f"carrier {carrier}, distributions {', '.join(_DISTROS)}")
    side.bridge("ros2", "--domain-id", str(world.domain), "--carrier", carrier)
    taken: dict[str, Counter[int]] = {"/ours": Counter(), "/our_goals": Counter()}

    def answer(request: Any) -> Any:
        taken["/ours"][request.depth] += 1
        return ListParameters.Response()

    async def execute(goal: Any) -> AsyncIterator[Any]:
        taken["/our_goals"][goal.request.order] += 1
        yield fibonacci.Feedback(sequence=[1])
        yield fibonacci.Result(sequence=[goal.request.order])

    far = Far(world)
    async with side.node("robot") as node, ActionServer(node, fibonacci, "/our_goals", execute):
        await node.create_service(ListParameters, "/ours", answer)
        task = asyncio.create_task(far.run())
        try:
            async with calls_to(far, node) as calls, goals_to(far, node) as goals:
                storms = Storms(side, far, {"/theirs": calls, "/their_goals": goals}, taken)
                while sum(storms.done.values()) < kills:
                    kinds = chance.choices(_KINDS, k=_PER_ROUND)
                    away_s = [chance.uniform(0.0, 1.5) for _ in kinds]
                    print(
                        "round:", ", ".join(f"{one} {s:.1f} s" for one, s in zip(kinds, away_s, strict=True))
                    )
                    await storms.round(kinds, away_s)
                print(f"faults: {dict(storms.done)}")
                print(f"until both sides had answers: {storms.longest_s:.1f} s at most")
                print(f"{calls}; carried out there {far.heard('/theirs').total()}")
                print(f"{goals}; carried out there {far.heard('/their_goals').total()}")
                for name, numbers in taken.items():
                    print(f"ROS 2, {name}: {far.answered[name]} answered, carried out {numbers.total()}")
        finally:
            task.cancel()
            far.kill()
            await asyncio.gather(task, return_exceptions=True)
            far.peer.close()


def main() -> int:
    why_not = "" if _DISTROS else why_no_ros("jazzy", "test_msgs")
    os.environ["BUS_INTERFACE_PATH"] = str(SHARE)
    return play("chaos.ros2", __doc__, 30, why_not, ("robot",), storm)


if __name__ == "__main__":
    sys.exit(main())
