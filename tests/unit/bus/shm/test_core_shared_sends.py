"""bus.shm._core.Sends.publish_shared: the quick way to publish, under the guard of a shared loop."""

import gc
import sys
import weakref
from collections.abc import Callable
from threading import RLock, Thread
from typing import Any

import pytest

from shm_ends import core


class Loop:
    def __init__(self) -> None:
        self.guard: Any = RLock()
        self.is_interrupted = False


class End:
    """A publisher that answers with `status`, and records the work that is left to it."""

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
    with pytest.raises(RuntimeError, match=r"share\(\) comes first"):  # the quick way is not set
        sends.publish_shared("a")


def test_without_a_guard() -> None:
    end = End()
    end.sends = core.Sends(print, print, print)
    end.sends.publish = end.publish
    end.sends.share(None, end.rest)
    assert end.sends.publish_shared("a") is None
    assert (end.tried, end.left) == ([("a", False)], [])
    end.status = b"encoded"
    end.sends.publish_shared("b")
    assert end.left == [("b", b"encoded", False)]
    end.status = ValueError("no")
    with pytest.raises(ValueError, match="no"):
        end.sends.publish_shared("c")


def test_a_circle_through_it_is_collected() -> None:
    end = End()
    gone = weakref.ref(end)
    del end
    gc.collect()
    assert gone() is None


class BadGuard:
    """A guard that runs `on_acquire`, and fails when it is released."""

    def __init__(self, on_acquire: Callable[[], object] = bool) -> None:
        self.on_acquire = on_acquire

    def acquire(self, _: bool) -> bool:
        self.on_acquire()
        return True

    def release(self) -> None:
        raise RuntimeError("not given back")

    def _is_owned(self) -> bool:
        return True


def shared_by(guard: BadGuard, status: Any) -> End:
    end = End(status)
    end.loop.guard = guard
    end.sends = core.Sends(print, print, print)
    end.sends.publish = end.publish
    end.sends.share(end.loop, end.rest)
    return end


def test_the_message_by_its_name() -> None:
    """Programs of ROS 2 may name it: `publisher.publish(msg=message)`."""
    end = End()
    end.sends.publish_shared(msg="a")
    assert end.tried == [("a", True)]
    wrong: Any = end.sends.publish_shared
    for call in (
        lambda: wrong(),
        lambda: wrong("a", "b"),
        lambda: wrong("a", msg="b"),
        lambda: wrong(data="a"),
    ):
        with pytest.raises(TypeError):
            call()
    assert len(end.tried) == 1


def test_nothing_is_left_of_an_error_where_the_guard_is_not_given_back() -> None:
    end = shared_by(BadGuard(), LookupError([]))
    marker = end.status.args[0]
    before = sys.getrefcount(marker)
    with pytest.raises(RuntimeError, match="not given back"):
        end.sends.publish_shared("a")
    end.status = True
    gc.collect()
    assert sys.getrefcount(marker) < before  # the error held a reference, and is gone


def test_the_quick_way_may_go_before_the_guard_is_there() -> None:
    end = End()
    sends = end.sends = core.Sends(print, print, print)
    sends.publish = end.publish
    end.loop.guard = BadGuard(lambda: delattr(sends, "publish"))
    end.loop.guard.release = bool
    sends.share(end.loop, end.rest)
    sends.publish_shared("a")
    assert (end.tried, end.left) == ([], [("a", None, True)])
