"""Futures and tasks of the facade: results, callbacks, steps of coroutines, threads."""

import asyncio
import gc
import threading
from collections.abc import Callable
from typing import Any

import pytest

from bus_ros.rclpy.task import UNFINISHED, Answer, Future, Step, Task


class Executor:
    """Takes tasks, and runs them on request. A task that is woken is queued again."""

    def __init__(self) -> None:
        self.line: list[Task[Any]] = []

    def create_task(self, callback: Any, *args: Any, **kwargs: Any) -> Task[Any]:
        task: Task[Any] = Task(callback, args, kwargs, executor=self)  # type: ignore[arg-type]
        task.reschedule = lambda: self.line.append(task)
        self.line.append(task)
        return task

    def run(self) -> int:
        """Run until no task is queued. Returns the number of steps."""
        steps = 0
        while self.line:
            self.line.pop(0)()
            steps += 1
        return steps


def test_a_future_gets_a_result() -> None:
    future: Future[int] = Future()
    assert (future.done(), future.result(), future.exception()) == (False, None, None)
    heard: list[int | None] = []
    future.add_done_callback(lambda done: heard.append(done.result()))
    future.set_result(3)
    future.add_done_callback(lambda done: heard.append(done.result()))
    assert (future.done(), future.cancelled(), future.result(), heard) == (True, False, 3, [3, 3])


def test_an_exception_is_raised_by_result() -> None:
    future: Future[int] = Future()
    error = RuntimeError("no")
    future.set_exception(error)
    assert future.done() and future.exception() is error
    with pytest.raises(RuntimeError, match="no"):
        future.result()


def test_cancel() -> None:
    future: Future[int] = Future()
    heard: list[bool] = []
    future.add_done_callback(lambda done: heard.append(done.cancelled()))
    future.cancel()
    future.cancel()
    assert (future.done(), future.cancelled(), future.result(), heard) == (True, True, None, [True])
    done: Future[int] = Future()
    done.set_result(1)
    done.cancel()
    assert not done.cancelled()


@pytest.mark.parametrize("fails", [False, True])
def test_an_answer_after_cancel_is_ignored(fails: bool) -> None:
    """Another thread may set it at the same time."""
    future, dropped, heard = Answer[int](), list[Any](), list[Any]()
    future.drop = dropped.append
    future.add_done_callback(heard.append)
    future.cancel()
    future.set_exception(ValueError("late")) if fails else future.set_result(5)
    assert future.cancelled() and future.result() is None
    assert dropped == heard == [future]


def test_an_exception_that_nobody_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    future: Future[int] = Future()
    future.set_exception(RuntimeError("lost"))
    del future
    gc.collect()
    assert capsys.readouterr().err == "The following exception was never retrieved: lost\n"


def test_callbacks_that_raise() -> None:
    def bad(future: Future[int]) -> None:
        raise RuntimeError("bad")

    future: Future[int] = Future()
    heard: list[Future[int]] = []
    future.add_done_callback(bad)
    future.add_done_callback(heard.append)
    with pytest.warns(UserWarning, match="Unhandled exception in done callback: bad"):
        future.set_result(1)
    assert heard == [future]
    with pytest.raises(RuntimeError, match="bad"):
        future.add_done_callback(bad)


def test_callbacks_can_be_taken_back() -> None:
    future: Future[int] = Future()
    heard: list[Future[int]] = []
    future.add_done_callback(heard.append)
    assert future.remove_done_callback(heard.append)
    assert not future.remove_done_callback(heard.append)
    future.set_result(1)
    assert heard == []


def test_callbacks_run_in_the_executor() -> None:
    executor = Executor()
    future: Future[int] = Future(executor=executor)  # type: ignore[arg-type]
    heard: list[int | None] = []
    future.add_done_callback(lambda done: heard.append(done.result()))
    waited: list[str] = []
    future.call_when_done(lambda: waited.append("at once"))
    future.set_result(1)
    future.add_done_callback(lambda done: heard.append(done.result()))
    future.call_when_done(lambda: waited.append("again"))
    assert (heard, waited) == ([], ["at once", "again"])
    executor.run()
    assert heard == [1, 1]


def test_an_executor_that_is_gone_is_no_executor() -> None:
    future: Future[int] = Future(executor=Executor())  # type: ignore[arg-type]
    gc.collect()
    heard: list[Future[int]] = []
    future.add_done_callback(heard.append)
    future.set_result(1)
    assert heard == [future]


def test_a_task_calls_a_function() -> None:
    task: Task[int] = Task(lambda a, b: a - b, (5,), {"b": 2})
    assert not task.done() and not task.executing()
    task()
    task()
    assert task.result() == 3


def test_a_task_keeps_what_its_function_raises() -> None:
    executor = Executor()
    task = executor.create_task(lambda: 1 / 0)
    executor.run()
    with pytest.raises(ZeroDivisionError):
        task.result()


def test_keyboard_interrupt_goes_through() -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    task: Task[None] = Task(interrupted)
    with pytest.raises(KeyboardInterrupt):
        task()
    assert not task.done() and not task.executing()


def test_a_coroutine_waits_without_being_called_again() -> None:
    executor = Executor()
    first: Future[int] = Future()
    second: Future[int] = Future()
    seen: list[bool] = []

    async def add(third: int) -> int:
        seen.append(task.executing())
        return (await first or 0) + (await second or 0) + third

    task = executor.create_task(add, 3)
    assert executor.run() == 1
    second.set_result(2)
    assert executor.run() == 0
    first.set_result(1)
    assert executor.run() == 1
    assert (task.result(), seen, task.executing()) == (6, [True], False)


def test_tasks_await_each_other() -> None:
    executor = Executor()

    async def outer() -> str:
        try:
            await inner
        except ZeroDivisionError:
            return "caught"
        return "missed"

    task = executor.create_task(outer)
    inner = executor.create_task(lambda: 1 / 0)
    executor.run()
    assert task.result() == "caught"


def test_a_coroutine_object_and_one_that_only_yields() -> None:
    executor = Executor()
    turns: list[str] = []

    async def polite(name: str) -> None:
        for _ in range(2):
            turns.append(name)
            await asyncio.sleep(0)

    executor.create_task(polite("a"))
    executor.create_task(polite, "b")
    executor.run()
    assert turns == ["a", "b", "a", "b"]


def test_awaiting_what_an_executor_can_not_wait_for() -> None:
    loop = asyncio.new_event_loop()
    try:
        strange = loop.create_future()

        async def wrong() -> None:
            await strange

        task: Task[None] = Task(wrong)
        task()
        with pytest.raises(TypeError, match="a callback can await rclpy's futures and other callbacks only"):
            task.result()
    finally:
        loop.close()


def test_a_cancelled_task_closes_its_coroutine() -> None:
    executor = Executor()
    ended: list[str] = []

    async def wait() -> None:
        try:
            await Future()
        finally:
            ended.append("closed")

    task = executor.create_task(wait)
    executor.run()
    task.cancel()
    assert (task.cancelled(), ended) == (True, ["closed"])
    task()
    never = executor.create_task(wait())
    never.cancel()  # a coroutine that never began is closed, too, without a warning
    assert executor.run() == 1


def test_a_future_that_gets_done_while_the_step_ends() -> None:
    """The task must be queued again, whichever comes first."""
    for _ in range(200):
        future: Future[int] = Future()
        woken = threading.Event()

        async def wait(future: Future[int] = future) -> int | None:
            return await future

        task: Task[int] = Task(wait, reschedule=woken.set)
        thread = threading.Thread(target=future.set_result, args=(1,))
        thread.start()
        task()
        thread.join(60)
        if not task.done():
            assert woken.wait(60)
            task()
        assert task.result() == 1


def test_only_the_last_step_of_a_task_is_its_end() -> None:
    """Another thread may run the last step before the one before it has returned."""

    class Sudden(Future[int]):
        def call_when_done(self, waiter: Callable[[], object]) -> None:
            self.set_result(1)
            super().call_when_done(waiter)

    async def work() -> None:
        await Sudden()

    ends: list[bool] = []
    step = Step(Task(work), lambda again: ends.append(again.run() is not UNFINISHED), None)
    ends.append(step.run() is not UNFINISHED)
    assert step.task.done()
    assert ends == [True, False]


def test_one_step_at_a_time() -> None:
    inside, release = threading.Event(), threading.Event()
    calls: list[int] = []

    def slow() -> None:
        calls.append(1)
        inside.set()
        assert release.wait(60)

    task: Task[None] = Task(slow)
    thread = threading.Thread(target=task)
    thread.start()
    assert inside.wait(60)
    assert task.executing()
    task()
    release.set()
    thread.join(60)
    assert (calls, task.done()) == ([1], True)


def test_results_from_many_threads_wake_each_waiter_once() -> None:
    future: Future[int] = Future()
    heard: list[int] = []
    append: Callable[[], None] = lambda: heard.append(1)  # noqa: E731
    threads = [threading.Thread(target=future.call_when_done, args=(append,)) for _ in range(8)]
    for thread in threads[:4]:
        thread.start()
    future.set_result(1)
    for thread in threads[4:]:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert len(heard) == 8


async def awaited(future: Future[int]) -> int | None:
    return await future


class TestInAsyncio:
    """Futures that tasks of asyncio await."""

    def test_a_result_of_another_thread(self) -> None:
        async def main() -> list[int | None]:
            futures: list[Future[int]] = [Future(), Future(), Future()]
            futures[2].set_result(2)
            threads = [threading.Thread(target=futures[index].set_result, args=(index,)) for index in (1, 0)]
            asyncio.get_running_loop().call_soon(lambda: [thread.start() for thread in threads])
            found = await asyncio.gather(*futures)
            for thread in threads:
                thread.join(60)
            return found

        assert asyncio.run(main()) == [0, 1, 2]

    def test_an_exception_and_a_cancelled_future(self) -> None:
        async def main() -> None:
            failed: Future[int] = Future()
            cancelled: Future[int] = Future()
            loop = asyncio.get_running_loop()
            loop.call_soon(failed.set_exception, ValueError("no"))
            loop.call_soon(cancelled.cancel)
            with pytest.raises(ValueError, match="no"):
                await failed
            assert await cancelled is None

        asyncio.run(main())

    def test_a_timeout_leaves_the_future(self) -> None:
        future: Future[int] = Future()

        async def main() -> None:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(future, 0.01)
            assert not future.done() and future._waiters == []

        asyncio.run(main())
        future.set_result(1)

    def test_a_result_after_the_end_of_the_loop(self) -> None:
        future: Future[int] = Future()
        loop = asyncio.new_event_loop()
        task = loop.create_task(awaited(future))
        loop.run_until_complete(asyncio.sleep(0))
        loop.close()
        future.set_result(1)
        assert not task.done()
        task._log_destroy_pending = False  # type: ignore[attr-defined]

    def test_the_loop_sleeps_meanwhile(self) -> None:
        future: Future[int] = Future()

        async def main() -> int:
            turns = 0
            task = asyncio.ensure_future(awaited(future))
            loop = asyncio.get_running_loop()
            loop.call_later(0.05, future.set_result, 1)
            ready = loop._run_once  # type: ignore[attr-defined]

            def counted() -> None:
                nonlocal turns
                turns += 1
                ready()

            loop._run_once = counted  # type: ignore[attr-defined]
            assert await task == 1
            return turns

        assert asyncio.run(main()) < 20

    def test_an_executor_that_spins_in_a_task_of_asyncio(self) -> None:
        """Its own coroutines await as ever, and the task of asyncio awaits their result."""
        executor, future = Executor(), Future[int]()

        async def main() -> int | None:
            task = executor.create_task(awaited, future)
            assert executor.run() == 1
            result = asyncio.ensure_future(awaited(task))
            await asyncio.sleep(0)
            future.set_result(5)
            assert executor.run() == 1
            return await result

        assert asyncio.run(main()) == 5

    def test_asyncio_in_a_step_of_a_task(self) -> None:
        executor, future = Executor(), Future[int]()

        async def callback() -> tuple[int | None, int | None]:
            thread = threading.Thread(target=future.set_result, args=(3,))
            thread.start()
            inner = asyncio.run(awaited(future))
            thread.join(60)
            return inner, await future

        task = executor.create_task(callback)
        executor.run()
        assert task.result() == (3, 3)
