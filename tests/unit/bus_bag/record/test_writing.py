"""The writing thread."""

import threading

from bus_bag.errors import BagFull
from bus_bag.record.writing import WritingThread


def test_jobs_run_in_order_and_are_told_of() -> None:
    done: list[int] = []
    told = threading.Semaphore(0)
    thread = WritingThread(told.release)
    for number in range(5):
        thread.run(lambda number=number: done.append(number), 10)
    assert thread.end(30)
    assert done == [0, 1, 2, 3, 4]
    assert (thread.is_idle, thread.waiting_bytes) == (True, 0)
    assert all(told.acquire(blocking=False) for _ in range(5))


def test_after_a_failure_nothing_runs() -> None:
    done: list[int] = []
    failed = threading.Event()
    thread = WritingThread(failed.set)

    def fail() -> None:
        raise BagFull("no room")

    thread.run(fail, 10)
    assert failed.wait(30)
    thread.run(lambda: done.append(1), 10)
    assert thread.end(30)
    assert (done, str(thread.failure), thread.waiting_bytes) == ([], "no room", 0)


def test_what_waits_is_dropped_and_a_slow_disk_waited_for_so_long() -> None:
    may_go, done = threading.Event(), []
    begun = threading.Event()

    def slow() -> None:
        begun.set()
        may_go.wait(30)

    thread = WritingThread(lambda: None)
    thread.run(slow, 10)
    assert begun.wait(30)
    thread.run(lambda: done.append(1), 20)
    thread.run(lambda: done.append(2), 0)  # a topic or a file, which later jobs need
    assert thread.waiting_bytes == 30
    thread.drop()
    assert (thread.waiting_bytes, thread.is_idle) == (10, False)
    assert not thread.end(0.01)
    may_go.set()
    assert thread.end(30)
    assert done == [2]
