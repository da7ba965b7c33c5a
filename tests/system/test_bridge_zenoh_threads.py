"""What Python knows of the threads in which zenoh calls back: kept as long as these live, and bounded."""

import asyncio
import ctypes
import threading

import pytest

pytest.importorskip("zenoh", reason="needs the extra zenoh: pip install 'busd[zenoh]'")

from bus_bridge.zenoh import session
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.session import Session
from conftest import WAIT_S
from ports import free_port

_KEY = "busd/test/threads"
_MESSAGES = 10


@pytest.fixture(autouse=True, scope="module")
def zenoh_runtime() -> None:
    """What zenoh keeps for the whole process is there before the first test: none seems to leave it."""
    asyncio.run(_meet())


def thread_states() -> int:
    """Of how many threads Python knows something."""
    api, count = ctypes.pythonapi, 0
    for name in ("PyInterpreterState_Get", "PyInterpreterState_ThreadHead", "PyThreadState_Next"):
        getattr(api, name).restype = ctypes.c_void_p
    state = api.PyInterpreterState_ThreadHead(ctypes.c_void_p(api.PyInterpreterState_Get()))
    while state:
        count += 1
        state = api.PyThreadState_Next(ctypes.c_void_p(state))
    return count


async def test_it_does_not_grow_as_links_come_and_go() -> None:
    counts: list[int] = []
    for _ in range(10):
        await _meet()
        for thread in threading.enumerate():
            if thread.name == "bus_bridge zenoh":
                thread.join(WAIT_S)
        counts.append(thread_states())
    # Another of zenoh's few threads that stay may call back for the first time; more would be one each time.
    assert counts[-1] - counts[1] < len(counts) // 2


async def _meet() -> None:
    """Two sessions, a link between them, and some messages."""
    where, faults = f"tcp/127.0.0.1:{free_port()}", list[Exception]()
    ways = ZenohOptions(listen=(where,)), ZenohOptions(connect=(where,))
    ends = [Session(way, faults.append) for way in ways]
    heard: list[bytes] = []
    for one in ends:
        await one.open()
    try:
        ends[0].subscribe(_KEY, lambda key, payload, _: heard.append(payload))
        async with asyncio.timeout(WAIT_S):
            while len(heard) < _MESSAGES:
                ends[1].put(_KEY, b"x")
                await asyncio.sleep(0.002)
    finally:
        for one in ends:
            await one.close()
    assert not faults


def test_of_more_threads_than_zenoh_has_python_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "_MOST_KEPT_THREADS", session._kept_threads + 2)
    monkeypatch.setattr(session, "_kept_threads", session._kept_threads)
    before = thread_states()
    call = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)(lambda _: session._keep_thread())
    libc = ctypes.CDLL(None)  # threads that Python does not know, as those of zenoh
    for _ in range(5):
        thread = ctypes.c_ulong()
        assert libc.pthread_create(ctypes.byref(thread), None, call, None) == 0
        assert libc.pthread_join(thread, None) == 0
    assert thread_states() == before + 2
