"""Python's states of the threads in which zenoh calls back: each is kept from one message to the next."""

import asyncio
import os
import threading
from collections import defaultdict
from typing import TypeAlias

import pytest

pytest.importorskip("zenoh", reason="needs the extra zenoh: make setup installs it")

from bus import shm
from bus_bridge.errors import BridgeError
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.session import Session
from conftest import WAIT_S
from neighbours import descriptors_of
from ports import free_port
from thread_states import this_state

_KEY = "busd/test/threads"
_MESSAGES = 10
States: TypeAlias = defaultdict[int, set[int]]
"""States of each thread, by its native id."""


@pytest.fixture(autouse=True, scope="module")
def zenoh_runtime() -> None:
    """Makes zenoh open its per-process descriptors first, so that no test seems to leak them."""
    asyncio.run(_meet(States(set)))


@pytest.mark.skipif(not shm.has_core(), reason="the native core keeps it, and was not built")
async def test_it_is_the_same_for_all_messages_of_all_links() -> None:
    states = States(set)
    for _ in range(10):
        await _meet(states)
    assert [len(found) for found in states.values()] == [1] * len(states)


async def _meet(states: States) -> None:
    """Two sessions with a link between them exchange messages.

    `states` gets the states of the threads that deliver them.
    """
    where, faults = f"tcp/127.0.0.1:{free_port()}", list[Exception]()
    ways = ZenohOptions(listen=(where,)), ZenohOptions(connect=(where,))
    ends = [Session(way, faults.append) for way in ways]
    heard: list[bytes] = []

    def hear(_: object, payload: bytes, __: bytes | None) -> None:
        states[threading.get_native_id()].add(this_state())
        heard.append(payload)

    for one in ends:
        await one.open()
    try:
        ends[0].subscribe(_KEY, hear)
        async with asyncio.timeout(WAIT_S):
            while len(heard) < _MESSAGES:
                ends[1].put(_KEY, b"x")
                await asyncio.sleep(0.002)
    finally:
        for one in ends:
            await one.close()
    assert not faults


async def test_where_no_thread_can_start_nothing_stays_open(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    before = descriptors_of(os.getpid())
    with monkeypatch.context() as exhausted:
        exhausted.setattr(threading.Thread, "start", refuse)
        with pytest.raises(BridgeError, match="zenoh can't start its thread: can't start new thread"):
            await Session(ZenohOptions(), list[Exception]().append).open()
    assert descriptors_of(os.getpid()) == before
