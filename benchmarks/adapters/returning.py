"""A program with many matches, which loses busd and gets all of them again after a restart of busd.

It says `ready` when all matches are made, `lost` when they are gone, and `back` with `at_ns` when all have
returned. Then it waits for the next loss.
"""

import asyncio
from time import monotonic_ns

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.std_msgs import String

_LOOK_S = 0.02
_LIFE_S = 600


class Many(msgspec.Struct, frozen=True):
    """The number of publishers, and of subscriptions, of one topic."""

    each: int

    @property
    def matches(self) -> int:
        return self.each**2


async def main(parent: Parent) -> None:
    many: Many = options(Many)
    async with bus.Node("many") as node:
        pubs, subs = [], []
        for _ in range(many.each):
            pubs.append(await node.create_publisher(String, "many", 1))
            subs.append(await node.create_subscription(String, "many", 1, _hear))

        async def until(matches: int) -> None:
            """Wait until both sides have that number of matches."""
            while any(  # noqa: ASYNC110  there is no event for the sum
                sum(found) != matches
                for found in (
                    [one.get_subscription_count() for one in pubs],
                    [one.get_publisher_count() for one in subs],
                )
            ):
                await asyncio.sleep(_LOOK_S)

        await until(many.matches)
        parent.tell("ready")
        while True:
            await until(0)
            parent.tell("lost")
            await until(many.matches)
            parent.tell("back", at_ns=monotonic_ns())


def _hear(message: String) -> None:
    """Never called: nothing is published."""


if __name__ == "__main__":
    run(main, life_s=_LIFE_S)
