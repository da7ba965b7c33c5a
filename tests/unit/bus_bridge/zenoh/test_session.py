"""The way from zenoh's threads to the loop: nothing is forgotten, and nothing arrives after the end."""

import asyncio
import os
import sys
from collections.abc import Iterator
from threading import Thread

import pytest

pytest.importorskip("zenoh", reason="needs the extra zenoh: make setup installs it")

from bus_bridge.zenoh.session import Source, _Inbox
from conftest import WAIT_S

_THINGS = 5000
_THREADS = 3


@pytest.fixture(autouse=True)
def threads_interrupt_each_other() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


class Threads:
    """Each thread pushes its items in order into its own source."""

    def __init__(self, inbox: _Inbox) -> None:
        self.taken: list[list[int]] = [[] for _ in range(_THREADS)]
        self.has_all = asyncio.Event()
        self.sources = [
            Source(inbox, lambda thing, of=of: self._take(of, thing), 1 << 30, lambda _: None)
            for of in range(_THREADS)
        ]
        self._threads = [Thread(target=self._push, args=(one,)) for one in self.sources]
        for thread in self._threads:
            thread.start()

    def join(self) -> None:
        for thread in self._threads:
            thread.join(WAIT_S)

    def _push(self, source: Source[int]) -> None:
        for thing in range(_THINGS):
            source.push(thing)

    def _take(self, of: int, thing: int) -> None:
        self.taken[of].append(thing)
        if all(len(one) == _THINGS for one in self.taken):
            self.has_all.set()
        if thing % 100 == 99:
            raise ValueError


async def test_all_that_threads_push_is_taken_in_order_whatever_raises() -> None:
    faults: list[Exception] = []
    inbox = _Inbox(asyncio.get_running_loop(), faults.append)
    inbox.open()
    for _ in range(3):
        threads = Threads(inbox)
        async with asyncio.timeout(WAIT_S):
            await threads.has_all.wait()
        threads.join()
        assert threads.taken == [[*range(_THINGS)]] * _THREADS
    inbox.close()
    assert len(faults) == 3 * _THREADS * _THINGS // 100


async def test_what_comes_after_the_end_is_not_taken_nor_written_to_a_file_that_has_its_number() -> None:
    inbox, taken = _Inbox(asyncio.get_running_loop(), lambda _: None), list[int]()
    inbox.open()
    source, bell = Source(inbox, taken.append, 1, lambda _: None), inbox._bell
    inbox.close()
    inbox.close()
    assert bell is not None
    others = [os.eventfd(0, os.EFD_NONBLOCK)]
    while others[-1] < bell:
        others.append(os.eventfd(0, os.EFD_NONBLOCK))
    try:
        assert others[-1] == bell
        source.push(1)
        await asyncio.sleep(0)
        assert not taken
        with pytest.raises(BlockingIOError):
            os.eventfd_read(bell)
    finally:
        for one in others:
            os.close(one)
