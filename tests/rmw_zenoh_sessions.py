"""Two sessions of `bus_bridge.rmw_zenoh` on loopback. Needs zenoh."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from bridged_world import until
from bus_bridge.rmw_zenoh.session import RosSession
from bus_bridge.zenoh.options import ZenohOptions
from ports import free_port

__all__ = ["linked", "zenoh_runs"]


@asynccontextmanager
async def linked() -> AsyncIterator[tuple[RosSession, RosSession]]:
    faults: list[Exception] = []
    place = f"tcp/127.0.0.1:{free_port()}"
    one = RosSession(ZenohOptions(listen=(place,)), faults.append)
    other = RosSession(ZenohOptions(connect=(place,)), faults.append)
    await one.open()
    await other.open()
    try:
        await until(lambda: one.links() and other.links())
        yield one, other
    finally:
        await one.close()
        await other.close()
    assert faults == []


@pytest.fixture(scope="module", autouse=True)
def zenoh_runs() -> None:
    """zenoh's threads start with the first link, and keep their descriptors until the process ends."""

    async def link() -> None:
        async with linked():
            pass

    asyncio.run(link())
