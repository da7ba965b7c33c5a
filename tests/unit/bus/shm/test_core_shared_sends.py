"""bus.shm._core.Sends.publish_shared: the quick way of a publish, under the guard of a shared loop."""

import gc
import weakref
from threading import RLock, Thread
from typing import Any

import pytest

from shm_ends import core


class Loop:
    def __init__(self) -> None:
        self.guard: Any = RLock()
        self.is_interrupted = False


class End:
    """A publisher that answers with `status`, and notes what it was left to do."""

    def __init__(self, status: Any = True) -> None:
        self.loop = Loop()
        self.status = status
        self.tried: list[Any] = []
        self.left: list[Any] = []
        self.sends = core.Sends(print, print, print)
        self.sends.publish = self.publish
        self.sends.share(self.loop, self.rest)

    def publish(self, message: Any) -> Any:
        self.tried.append((message, self.loop.guard._is_owned()))
        if isinstance(self.status, BaseException):
            raise self.status
        return self.status

    def rest(self, message: Any, status: Any) -> None:
        self.left.append((message, status, self.loop.guard._is_owned()))


def test_a_message_is_taken_under_the_guard() -> None:
    end = End()
    end.sends.publish_shared("a")
    assert (end.tried, end.left) == ([("a", True)], [])
    assert not end.loop.guard._is_owned()


@pytest.mark.parametrize("status", [False, 0, core.REPORT_DUE, b"encoded"])
def test_the_rest_is_done_without_the_guard(status: Any) -> None:
    end = End(status)
    end.sends.publish_shared("a")
    assert end.left == [("a", status, False)]


def test_nothing_is_tried_while_another_thread_has_the_guard() -> None:
    end = End()
    with end.loop.guard:
        thread = Thread(target=end.sends.publish_shared, args=("a",))
        thread.start()
        thread.join()
    assert (end.tried, end.left) == ([], [("a", None, False)])


def test_a_thread_that_has_the_guard_keeps_it() -> None:
    end = End()
    with end.loop.guard:
        end.sends.publish_shared("a")
        assert end.loop.guard._is_owned()
    assert end.tried == [("a", True)]


def test_an_interrupt_that_came_meanwhile_is_left() -> None:
    end = End()
    end.loop.is_interrupted = True
    end.sends.publish_shared("a")
    assert end.left == [("a", True, False)]


def test_what_the_quick_way_raises_comes_out_without_the_guard() -> None:
    end = End(ZeroDivisionError("here"))
    with pytest.raises(ZeroDivisionError, match="here"):
        end.sends.publish_shared("a")
    assert not end.loop.guard._is_owned()


def test_it_is_shared_once_and_first() -> None:
    sends = core.Sends(print, print, print)
    with pytest.raises(RuntimeError, match=r"share\(\) comes first"):
        sends.publish_shared("a")
    with pytest.raises(AttributeError, match="guard"):
        sends.share(object(), print)
    sends.share(Loop(), print)
    with pytest.raises(RuntimeError, match="called once"):
        sends.share(Loop(), print)
    with pytest.raises(RuntimeError, match=r"share\(\) comes first"):  # no quick way is set
        sends.publish_shared("a")


def test_a_circle_through_it_is_collected() -> None:
    end = End()
    gone = weakref.ref(end)
    del end
    gc.collect()
    assert gone() is None
