"""bus.transport.hangups: one descriptor for all streams of an event loop, while the loop has streams."""

import asyncio
import os
import socket
import sys
from collections.abc import Iterator
from threading import Thread
from types import SimpleNamespace
from typing import Any

import pytest

from bus.transport.hangups import HangUps
from conftest import WAIT_S

pytestmark = pytest.mark.both_loops

Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def pairs() -> Iterator[list[Pair]]:
    pairs = [socket.socketpair() for _ in range(3)]
    yield pairs
    for pair in pairs:
        for one in pair:
            one.close()


def hang_ups() -> HangUps:
    found = HangUps.of(asyncio.get_running_loop())
    if found is None:
        pytest.skip("this event loop tells of the end as long as it is there")
    return found


async def test_those_that_have_gone_are_told_once(pairs: list[Pair]) -> None:
    told, watch = list[int](), hang_ups()
    for at, (mine, _) in enumerate(pairs):
        watch.watch(mine.fileno(), lambda at=at: told.append(at))  # type: ignore[misc]
    assert hang_ups() is watch
    pairs[0][0].send(b"unread")
    pairs[0][1].close()
    pairs[1][1].send(b"something has come")
    pairs[2][1].shutdown(socket.SHUT_WR)  # it can still read
    async with asyncio.timeout(WAIT_S):
        while not told:  # noqa: ASYNC110
            await asyncio.sleep(0)
    await asyncio.sleep(0.01)
    assert told == [0]
    for mine, _ in pairs:
        watch.forget(mine.fileno())


async def test_the_last_one_closes_it(pairs: list[Pair]) -> None:
    watch = hang_ups()
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    for mine, _ in pairs:
        watch.watch(mine.fileno(), lambda: None)
    for mine, _ in pairs:
        watch.forget(mine.fileno())
        watch.forget(mine.fileno())
    assert len(os.listdir("/proc/self/fd")) == before - 1  # noqa: PTH208
    again = hang_ups()
    assert again is not watch
    again.watch(pairs[0][0].fileno(), lambda: None)
    again.forget(pairs[0][0].fileno())


async def test_one_that_is_forgotten_by_another_is_not_told(pairs: list[Pair]) -> None:
    told, watch = list[int](), hang_ups()
    numbers = [mine.fileno() for mine, _ in pairs[:2]]

    def tell(at: int) -> None:
        told.append(at)
        watch.forget(numbers[1 - at])

    for at, number in enumerate(numbers):
        watch.watch(number, lambda at=at: tell(at))  # type: ignore[misc]
    for _, other in pairs[:2]:
        other.close()
    async with asyncio.timeout(WAIT_S):
        while not told:  # noqa: ASYNC110
            await asyncio.sleep(0)
    await asyncio.sleep(0.01)
    assert len(told) == 1
    watch.forget(numbers[told[0]])


def nothing(*_: object) -> None:
    pass


def test_loops_of_several_threads_do_not_meet() -> None:
    mine, other = socket.socketpair()
    ends, errors = [os.dup(mine.fileno()) for _ in range(8)], list[Exception]()
    interval = sys.getswitchinterval()

    def come_and_go(number: int) -> None:
        try:
            for _ in range(6000):
                loop: Any = SimpleNamespace(add_reader=nothing, remove_reader=nothing)
                watch = HangUps.of(loop)
                assert watch is not None
                watch.watch(number, lambda: None)
                watch.forget(number)
        except Exception as error:
            errors.append(error)

    threads = [Thread(target=come_and_go, args=(end,)) for end in ends]
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
        for one in (mine, other):
            one.close()
        for end in ends:
            os.close(end)
    assert errors == []
