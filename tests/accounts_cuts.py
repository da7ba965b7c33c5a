"""Connections of `accounts_world` that end and come back, and the actions of others meanwhile."""

import asyncio
from collections.abc import Iterable
from typing import Any, TypeAlias, TypeVar

from accounts_process import Process
from accounts_world import World
from conftest import WAIT_S

Chosen = TypeVar("Chosen")
Happening: TypeAlias = tuple[Any, ...]
"""An action while a connection is away: a word, an index of the endpoint or process, and more."""


class Cuts:
    """The cuts of a `world`."""

    def __init__(self, world: World) -> None:
        self._world = world

    async def cut(
        self,
        processes: list[int],
        meanwhile: list[Happening],
        *,
        how: str = "hang up",
        before: list[Happening] | None = None,
        again: list[Happening] | None = None,
    ) -> None:
        """End the connections of `processes`; with "restart", busd ends, too.

        They are back after the actions in `meanwhile`. With `again`, they lose that connection before they
        have received anything, and these actions follow. With "stand still", a process reads nothing after
        the start of `before`.
        """
        world = self._world
        cut, away = [world.processes[number] for number in processes], set(processes)
        losses = [process.losses for process in cut]
        for process in cut:
            process.gate.clear()
            if how == "stand still":
                process.stop_reading()
        for happening in before or ():
            await self._happen(happening, set(), busy=away)
            await world.settle()
        for number in away & world.model.blocked:
            world.peer(number).stream._rest.append(b"")  # like a full socket
        world.model.cut(away)
        if how == "restart":
            world.stop_busd()
        elif how == "hang up":
            world.peer(*processes).stream._lose(None)
        else:
            world.peer(*processes).refuse("a test")
        await self._when_lost(cut if how != "stand still" else [], losses, 1)
        for happening in meanwhile:
            await self._happen(happening, away, busy=away if how == "stand still" else set())
            if how != "restart":
                await world.settle()  # the others receive it in this order
        if how == "restart":
            world.start_busd()
        for process in cut:
            process.go_on_reading()
        await self._when_lost(cut, losses, 1)
        if again is not None and set(world.model.endpoints_of(*processes)):
            for process in cut:
                process.is_deaf = True
                process.gate.set()
            await self._when_lost(cut, losses, 2)
            world.model.return_deaf(away)
            for happening in again:
                await self._happen(happening, away, busy=set())
                await world.settle()
        for process in cut:
            process.is_deaf = False
            process.gate.set()
            await process.ask()
        await world.settle()
        for process in cut:
            world.model.connect_anew(process.number)
        if unknown := world.model.return_of(away):
            await world.unblock_all()
        for number in unknown:
            world.take_over(number)

    async def _when_lost(self, cut: list[Process], losses: list[int], more: int) -> None:
        async with asyncio.timeout(WAIT_S):
            while any(  # noqa: ASYNC110
                process.losses < before + more for process, before in zip(cut, losses, strict=False)
            ):
                await asyncio.sleep(0)

    async def _happen(self, happening: Happening, away: set[int], *, busy: set[int]) -> None:
        """Let a process act while the connections of others are `away`; not one of the `busy` processes."""
        world, model = self._world, self._world.model
        what, at, *more = happening
        there = {
            number: one
            for number, one in model.publishers.items()
            if one.process not in (busy if what == "publish" else busy | away)
        }
        others = {number for number in world.processes if number not in busy | away}
        if what == "publish" and there:
            publisher = pick(there, at)
            model.deliver_around(there[publisher], world.publish(publisher, more[0]), away)
        elif what == "leave" and there:
            publisher = pick(there, at)
            model.leave_around(there[publisher])
            await world.publishers.pop(publisher).close()
        elif what == "die" and (mortal := others - self._awaited_by(away)):
            process = pick(mortal, at)
            for publisher, one in there.items():
                if one.process == process:
                    del world.publishers[publisher]
                    model.leave_around(one, is_lost=True)
            await world.die(process)
        elif what == "come" and others - model.blocked:
            process = pick(others - model.blocked, at)
            # Not if it would share memory with a process that can't learn of it.
            if not {process} & model.sharing or not model.sharing & (busy | away | model.blocked):
                model.come_around(await world.make_publisher(process, more[0]), away)

    def _awaited_by(self, away: set[int]) -> set[int]:
        """Processes for which returning publishers of `away` processes wait, for a limited time."""
        publishers = {number for number, one in self._world.model.publishers.items() if one.process in away}
        return {one.process for one in self._world.model.subscriptions.values() if publishers & {*one.routes}}


def pick(among: Iterable[Chosen], at: int) -> Chosen:
    ordered = sorted(among)  # type: ignore[type-var]
    return ordered[at % len(ordered)]
