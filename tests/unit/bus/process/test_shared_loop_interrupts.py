"""Interrupts of the loop that threads share, at every step of taking and releasing the guard."""

import gc
import sys
import threading
from itertools import count
from types import FrameType

import pytest

from bus.process.shared_loop import GuardedLoop
from conftest import WAIT_S


class Interrupt:
    """Acts like a signal handler, at the call or return with the given number."""

    def __init__(self, loop: GuardedLoop, number: int) -> None:
        self.left = number
        self._loop = loop

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        if event == "return" and frame.f_code is GuardedLoop.__exit__.__code__:
            return  # Python does not check for signals there
        self.left -= event in ("call", "return", "c_return")
        if self.left == 0:
            self.left = -1
            if not self._loop.is_busy(frame):
                raise KeyboardInterrupt
            self._loop.is_interrupted = True


@pytest.mark.parametrize("is_held", [False, True], ids=["free", "held by another"])
def test_none_is_lost_and_nothing_stays_taken(is_held: bool) -> None:
    loop = GuardedLoop()
    try:
        for number in count(1):
            interrupt = Interrupt(loop, number)
            holder = Holder(loop) if is_held else None
            try:
                with pytest.raises(KeyboardInterrupt):
                    sys.setprofile(interrupt)
                    with loop:
                        pass
                    sys.setprofile(None)
                    if interrupt.left > 0:
                        raise KeyboardInterrupt  # ends the test: no place is left
            finally:
                sys.setprofile(None)
                if holder is not None:
                    holder.join()
            assert not loop.is_mine()
            assert not loop.is_interrupted
            assert not loop._contenders
            if interrupt.left > 0:
                break
        assert number > 5
    finally:
        loop.close()


class Holder:
    """Another thread that has the guard, and releases it when a thread waits for it."""

    def __init__(self, loop: GuardedLoop) -> None:
        self._loop = loop
        self._has_it, self._is_over = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._hold)
        self._thread.start()
        assert self._has_it.wait(WAIT_S)

    def join(self) -> None:
        self._is_over.set()
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive()

    def _hold(self) -> None:
        with self._loop.guard:
            self._has_it.set()
            while not self._loop._contenders and not self._is_over.wait(0.0001):
                pass


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_one_whose_making_is_broken_off_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    said = list[object]()
    monkeypatch.setattr(sys, "unraisablehook", lambda what: said.append(repr(what.exc_value)))
    for steps in count(1):
        left = steps

        def break_off(frame: FrameType, event: str, called: object) -> None:
            nonlocal left
            # An interrupt there would leave a descriptor open.
            is_pythons = frame.f_globals["__name__"] == "socket"
            left -= called is not sys.setprofile and not is_pythons
            if not left:
                raise KeyboardInterrupt

        sys.setprofile(break_off)
        try:
            loop = GuardedLoop()
        except KeyboardInterrupt:
            pass
        else:
            break
        finally:
            sys.setprofile(None)
        gc.collect()  # also the exception's frames
    loop.close()
    assert (steps > 20, said) == (True, [])
