"""Executors: they wait until callbacks of their nodes are due, and call them, in one thread or in many.

Owns the order of calls, and the busy callback groups. A spinning thread runs the event loop while it waits
(`bus_ros.engine`); calls are made without the guard.
"""

import os
import warnings
from collections import deque
from collections.abc import Callable, Coroutine
from time import monotonic_ns
from types import CoroutineType
from typing import Any, TypeAlias
from weakref import ref

from bus_ros.engine import Waiter, deadline_after, engine
from bus_ros.entity import Entity, Owner, Work
from bus_ros.rclpy.context import Context, get_default_context
from bus_ros.rclpy.impl.executor_parts import (
    ConditionReachedException,
    ExecutedNode,
    ShutdownException,
    TimeoutException,
    TimeoutObject,
    WakeGuard,
    await_or_execute,
    go_on_with_round,
    spin_nested,
    woken_by,
)
from bus_ros.rclpy.impl.handover import Handover
from bus_ros.rclpy.task import UNFINISHED, Future, Step, Task, begin
from bus_ros.rclpy.timer import NEVER_NS

__all__ = [
    "ConditionReachedException",
    "EventsExecutor",
    "Executor",
    "ExternalShutdownException",
    "MultiThreadedExecutor",
    "ShutdownException",
    "SingleThreadedExecutor",
    "TimeoutException",
    "TimeoutObject",
    "await_or_execute",
]

Ready: TypeAlias = Entity | Step
Call: TypeAlias = tuple[Ready, Work]

MOST_AT_ONCE = 64
_ONE_THREAD = "MultiThreadedExecutor is used with a single thread.\nUse the SingleThreadedExecutor instead."
_SHIFT_NS = 20_000_000  # for this time, a worker makes following calls itself
_NOW: Future[Any] = Future()
_NOW.cancel()  # done from the start: `_next` does not wait


class ExternalShutdownException(Exception):
    """The context was shut down while an executor waited."""

    def __init__(self, *args: object) -> None:
        super().__init__(*(args or ("Context has been shutdown",)))


class Executor:
    """Base of the executors. A program's own one defines `spin_once`, by `wait_for_ready_callbacks`."""

    asks_always = False  # even if no group is held, some ready entities may have to wait

    def __init__(self, *, context: Context | None = None) -> None:
        self._context = context or get_default_context()
        self._engine = engine()
        self.waiter = Waiter(self._engine)
        self._nodes: list[ExecutedNode] = []
        self.ready: deque[Ready] = deque()
        self.handed: set[Handover] = set()  # they hand it messages as they come
        self._called: list[Ready] = []  # an entity for each call under way, in any thread
        self.last_handed: Handover | None = None
        self.lone: Handover | None = None  # the only one with messages recently
        self._left = 0  # entities of the round
        self._timer_ns = 0  # when a timer is due; `_next` does not look at timers before
        self._is_simulated = False  # then any message may have moved the time
        self._failures: deque[BaseException] = deque()
        self._is_shutdown = False
        self._only: list[ExecutedNode] | None = None  # the nodes asked for; None: all
        self._until: Callable[[], bool] | None = None  # a program's own executor spins until it is true
        self._guard: WakeGuard | None = WakeGuard(self.wake)
        self._engine.post(self._context.wake_at_end, self)

    @property
    def is_shutdown(self) -> bool:
        return self._is_shutdown

    @property
    def context(self) -> Context:
        return self._context

    def __enter__(self) -> "Executor":
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()

    # --- nodes and tasks

    def add_node(self, node: ExecutedNode) -> bool:
        """Work for `node` from now on; returns False if it does already."""
        if node.own_executor is self:
            return False
        if node.own_executor is not None:
            node.own_executor.remove_node(node)
        with self._engine.loop:
            self._nodes.append(node)
            node.own_executor, node.last_executor = self, ref(self)
            self._timer_ns = 0
            waiting, node.waiting = node.waiting, []
            for entity in sorted(waiting, key=lambda one: one.order):
                self.enqueue(entity)
        return True

    def remove_node(self, node: ExecutedNode) -> None:
        """Work for `node` no longer; its messages wait."""
        with self._engine.loop:
            if node.own_executor is not self:
                return
            node.own_executor = None
            self._nodes.remove(node)
            for handover in [one for one in self.handed if one.subscription.node is node]:
                handover.end()
            for entity in [one for one in self.ready if isinstance(one, Entity) and one.node is node]:
                self.ready.remove(entity)
                if entity.is_timer:
                    entity.is_queued = False
                else:
                    node.waiting.append(entity)

    def get_nodes(self) -> list[ExecutedNode]:
        """The nodes that it works for."""
        return list(self._nodes)

    def create_task(
        self, callback: Callable[..., object] | Coroutine[Any, Any, Any], *args: Any, **kwargs: Any
    ) -> Task[Any]:
        """Run `callback(*args)`, `def` or `async def`, or a coroutine in this executor; from any thread."""
        step = self._step(callback, args, kwargs)
        self._go_on_with(step)
        return step.task

    def wake(self) -> None:
        """Make a waiting thread look again; from any thread."""
        self._engine.post(self.wake_up)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop spinning. Returns whether all calls had ended by then."""
        with self._engine.loop:
            self._is_shutdown = True
            self._guard = None
            self.wake_up()
        for node in self.get_nodes():
            self.remove_node(node)
        return True

    # --- spinning

    def spin(self) -> None:
        """Work until the context or the executor is shut down; an exception in a callback comes out of here.

        Raises ExternalShutdownException if another thread or SIGTERM shuts the context down.
        """
        is_custom = self.is_custom()
        while self._context.ok() and not self._is_shutdown:
            if is_custom:
                self.spin_once()
            else:
                self._spin_once(0, MOST_AT_ONCE)
            if self._context.was_ended_by_signal:
                raise ExternalShutdownException

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one callback and call it; at most `timeout_sec` (None or negative: for ever)."""
        self._spin_once(deadline_after(timeout_sec), 1)

    def spin_until_future_complete(self, future: Future[Any], timeout_sec: float | None = None) -> None:
        """Work until `future` is done, or `timeout_sec` is over (None or negative: for ever; 0: one call)."""
        deadline_ns = deadline_after(timeout_sec)
        with woken_by(future, self.wake):
            while self._context.ok() and not self._is_shutdown and not future.done():
                self._spin_once(deadline_ns, 1, future.done)
                if deadline_ns and monotonic_ns() >= deadline_ns:
                    return

    def spin_once_until_future_complete(self, future: Future[Any], timeout_sec: float | None = None) -> None:
        """Wait for one callback or for `future`."""
        with woken_by(future, self.wake):
            if not future.done():
                self._spin_once(deadline_after(timeout_sec), 1, future.done)

    def wait_for_ready_callbacks(
        self,
        timeout_sec: "float | TimeoutObject | None" = None,
        nodes: list[ExecutedNode] | None = None,
        condition: Callable[[], bool] = lambda: False,
    ) -> tuple[Task[Any], Entity | None, Owner | None]:
        """Wait for one callback, of `nodes` if they are given. Not for several threads at once.

        Returns (handler, entity, node); the latter two are None for a task. The entity's group is held until
        the end of `handler()`, which makes the call, in any thread; `handler.exception()` is its exception. A
        coroutine that goes on comes again, with the same handler. `wake` makes it check `condition` again.

        Raises TimeoutException, ShutdownException, ExternalShutdownException, and ConditionReachedException.
        """
        until = self._until
        timeout_s = timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec

        def is_over() -> bool:
            return condition() or (until is not None and until())

        if is_over():
            raise ConditionReachedException
        with self._engine.loop:
            self._only, self.asks_always = nodes, nodes is not None or type(self).asks_always
            try:
                found = self._next(deadline_after(timeout_s), 1, is_over)
            finally:
                self._only, self.asks_always = None, type(self).asks_always
            if found is not None:
                return self._handler(*found)
        if self._is_shutdown:
            raise ShutdownException
        raise ConditionReachedException if is_over() else TimeoutException

    def can_execute(self, entity: Entity) -> bool:
        """Whether the entity's callback could begin now."""
        group = entity.callback_group
        return not entity.is_destroyed and (group is None or group.can_execute(entity))

    def is_custom(self) -> bool:
        """Whether the program defines `spin_once` itself."""
        return type(self).spin_once is not Executor.spin_once

    def _spin_once(self, deadline_ns: int, most: int, until: Callable[[], bool] | None = None) -> None:
        """Spin once by the `spin_once` of a program's own executor."""
        timeout_s = max(deadline_ns - monotonic_ns(), 0) / 1e9 if deadline_ns else None
        before, self._until = self._until, until
        try:
            if not self.is_custom():
                raise NotImplementedError(f"{type(self).__name__} has no spin_once")
            self.spin_once(timeout_sec=timeout_s)
        except ConditionReachedException:
            if until is None:
                raise
        finally:
            self._until = before

    # --- for entities, under the guard

    def enqueue(self, entity: Ready) -> None:
        """Add an entity that may have something to take."""
        entity.is_queued = True
        self.ready.append(entity)
        if not self.waiter.is_set:
            self.waiter.set()

    def on_timers_changed(self) -> None:
        """Note that a timer was made or changed."""
        self._timer_ns = 0
        self.waiter.set()

    def wake_up(self) -> None:
        self.waiter.set()

    def is_looking(self) -> bool:
        """Whether a thread waits here for calls to make."""
        return self._engine.is_waited_on(self.waiter)

    # --- inside, under the guard

    def _next(self, deadline_ns: int, most: int, until: Callable[[], bool] | None) -> Call | None:
        """The next call; None at the deadline, on shutdown of the executor, and once `until()` is true.

        Raises the exception of a call in another thread, and ExternalShutdownException.
        """
        waiter, ready, engine, is_over = self.waiter, self.ready, self._engine, False
        while True:
            if self._is_simulated or (self._timer_ns < NEVER_NS and monotonic_ns() >= self._timer_ns):
                self._collect_timers()
            if self._failures:
                raise self._failures.popleft()
            if self._is_shutdown:
                return None
            while ready:
                if len(ready) > 1:
                    go_on_with_round(self)
                entity = self._pop() if engine.held or self.asks_always else ready.popleft()
                if entity is None:
                    break
                if entity.is_destroyed:
                    work = None
                else:
                    try:
                        work = entity.take(most if entity.is_exclusive or not self.asks_always else 1)
                    except BaseException:
                        ready.append(entity)  # it stays queued
                        raise
                if work is not None and not entity.is_single:
                    ready.append(entity)  # it may have more, and is behind the others now
                    return entity, work
                entity.is_queued = False
                if entity.is_timer:
                    self._timer_ns = 0
                    if work is None:  # it was canceled in the queue
                        self._collect_timers()
                if work is not None:
                    return entity, work
            if until is not None and until():
                return None
            if not self._context.ok():
                if engine.loop.is_interrupted and engine.is_main():
                    return None  # as below
                raise ExternalShutdownException
            if is_over:
                return None
            waiter.is_set = False
            self._left = 0  # the round has ended
            end_ns = self._timer_ns
            if end_ns >= NEVER_NS or 0 < deadline_ns < end_ns:
                end_ns = deadline_ns
            lone = None if engine.held or self.asks_always else self.lone
            if lone is None or not lone.sleep(waiter, end_ns):
                engine.wait(waiter, end_ns, is_eager=True, takes_at_once=not self.asks_always)
            if engine.loop.is_interrupted and engine.is_main():
                return None  # the end of the guard raises KeyboardInterrupt
            is_over = deadline_ns > 0 and monotonic_ns() >= deadline_ns

    def _pop(self) -> Ready | None:
        """The first entity that may run."""
        for index, entity in enumerate(self.ready):
            group = entity.held_group
            if self._only is not None and entity.node not in self._only:
                continue
            if (group is None or group.can_execute(entity)) and not entity.is_closed:
                del self.ready[index]
                return entity
            self._engine.passed_over.add(self)
        return None

    def _collect_timers(self) -> None:
        now_ns, next_ns, self._is_simulated = monotonic_ns(), NEVER_NS, False
        for node in self._nodes:
            for timer in node.timers:
                self._is_simulated |= timer.is_simulated
                due_ns = timer.due_ns()
                if due_ns <= now_ns:
                    timer.is_queued = True
                    self.ready.append(timer)
                elif due_ns < next_ns:
                    next_ns = due_ns
        self._timer_ns = next_ns

    def _begin(self, entity: Ready) -> None:
        """Hold the entity's group until `_end`."""
        if entity.held_group is not None:
            entity.held_group.beginning_execution(entity)
            self._engine.held += 1

    def _handler(self, entity: Ready, work: Work) -> tuple[Task[Any], Entity | None, Owner | None]:
        """A task for a program that makes the call itself; its end is the end of the call."""
        if isinstance(entity, Step):
            step = entity
        else:
            self._begin(entity)
            step = self._step(*work, {}, entity)
        holder = step.holder
        if holder is not None and not step.ends_itself:
            step.ends_itself = True
            step.task.call_when_done(lambda: self._engine.call(self._end, holder))
        return step.task, holder, None if holder is None else holder.node

    def _end(self, entity: Ready) -> None:
        """Release the group after a call; after a step, the group of its holder."""
        if isinstance(entity, Step) and entity.ends_itself:
            return
        holder = entity.holder if isinstance(entity, Step) else entity
        if holder is not None and holder.held_group is not None:
            holder.held_group.ending_execution(holder)
            self._engine.held -= 1
            while self._engine.passed_over:
                self._engine.passed_over.pop().wake_up()

    # --- inside, without the guard

    def _step(
        self,
        function: Callable[..., object] | Coroutine[Any, Any, Any],
        arguments: tuple[object, ...],
        keywords: dict[str, Any],
        holder: Entity | None = None,
    ) -> Step:
        return Step(Task(function, arguments, keywords, executor=self), self._go_on_with, holder)

    def _go_on_with(self, step: Step) -> None:
        """Continue the step's task; from any thread."""
        self._engine.post(self.enqueue, step)

    def _run(self, entity: Ready, work: Work) -> bool:
        """Make a call; returns whether it has ended, or is a coroutine that goes on later."""
        function, arguments = work
        result = function(*arguments)
        if isinstance(result, CoroutineType) and entity.is_async:
            assert isinstance(entity, Entity)
            result = begin(result, lambda one: self._step(one, (), {}, entity).task)
        return result is not UNFINISHED


class SingleThreadedExecutor(Executor):
    """Makes the calls in the spinning thread."""

    def _spin_once(self, deadline_ns: int, most: int, until: Callable[[], bool] | None = None) -> None:
        called = self._called
        if called and spin_nested(self, deadline_ns, most, until):
            return
        loop = self._engine.loop
        with loop.guard:
            found = self._next(deadline_ns, most, until)
            if found is not None:
                entity, (function, arguments) = found
                is_plain = not entity.is_step
                if (group := entity.held_group) is not None and group.is_shared:
                    self._begin(entity)  # other groups are not held: calls of one thread do not meet
                    is_plain = False
        if loop.is_interrupted:
            loop.check()
        if found is None:
            return
        if is_plain:
            called.append(entity)
            try:
                result = function(*arguments)
            finally:
                called.pop()  # not always this one: only their number matters
            if not entity.is_async or not isinstance(result, CoroutineType):
                return
            with loop:
                self._begin(entity)
            function, arguments = lambda: result, ()  # the coroutine that was made
        has_ended = True
        try:
            has_ended = self._run(entity, (function, arguments))
        finally:
            if has_ended:
                with loop:
                    self._end(entity)


class MultiThreadedExecutor(Executor):
    """Makes the calls in `num_threads` threads; default: the number of CPUs.

    Under `spin`, a thread takes a run of messages of a subscription if its group is mutually exclusive.
    """

    asks_always = True  # a thread must be free

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        from bus_ros.rclpy.impl.worker_threads import WorkerThreads  # late: most programs have one thread

        super().__init__(context=context)
        if num_threads is None:
            num_threads = len(os.sched_getaffinity(0))
        if num_threads == 1:
            warnings.warn(_ONE_THREAD, stacklevel=2)
        self._threads = self._free = num_threads
        self._spinners = 0  # threads in `spin`; with any, workers make following calls themselves
        self._leaving: list[Waiter] = []  # they wait for the end of calls
        self._leavers = 0  # workers in `shutdown`; these do not wait for each other
        self._pool = WorkerThreads(num_threads, self._work, self._engine.loop, name="rclpy executor")

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop spinning, and wait `timeout_sec` at most for the end of the calls; returns whether they ended.

        It does not wait for a call that shuts down itself.
        """
        super().shutdown(timeout_sec)
        engine, deadline_ns = self._engine, deadline_after(timeout_sec)
        with engine.loop:
            self._pool.end()
            is_worker = self._pool.is_mine()
            self._leavers += is_worker
            self._notify_leaving()
            try:
                while self._threads - self._free > self._leavers:
                    waiter = Waiter(engine)
                    self._leaving.append(waiter)
                    if not waiter.wait(deadline_ns):
                        return False
                return True
            finally:
                self._leavers -= is_worker

    def _notify_leaving(self) -> None:
        leaving, self._leaving = self._leaving, []
        for waiter in leaving:
            waiter.set()

    def is_looking(self) -> bool:
        return self._free > 0 and super().is_looking()

    def _pop(self) -> Ready | None:
        return super()._pop() if self._free else None

    def spin(self) -> None:
        if self.is_custom():
            super().spin()
            return
        with self._engine.loop:
            self._spinners += 1
        try:
            super().spin()
        finally:
            with self._engine.loop:
                self._spinners -= 1

    def _spin_once(self, deadline_ns: int, most: int, until: Callable[[], bool] | None = None) -> None:
        with self._engine.loop:
            try:
                found = self._next(deadline_ns, most, until)
            except ExternalShutdownException:
                if self._context.was_ended_by_signal:
                    raise
                return  # one of our own calls may have shut down; rclpy's spin then ends, too
            if found is not None and not self.is_shutdown:
                try:
                    self._pool.hand(found)
                except RuntimeError:  # the interpreter ends, and this is a daemon thread
                    self._is_shutdown = True
                    return
                self._begin(found[0])
                self._free -= 1

    def _work(self, call: Call) -> None:
        """Make a call, and under `spin` the following ones: a change of threads costs more than most."""
        end_ns = monotonic_ns() + _SHIFT_NS
        found: Call | None = call
        while found is not None:
            failure: BaseException | None = None
            has_ended = True
            try:
                has_ended = self._run(*found)
            except BaseException as error:
                failure = error
            with self._engine.loop:
                self._free += 1
                self._engine.passed_over.discard(self)  # this thread looks itself
                if has_ended:
                    self._end(found[0])
                found = None
                if looks := failure is None and self._spinners > 0 and monotonic_ns() < end_ns:
                    try:
                        found = self._go_on()
                    except BaseException as error:
                        failure = error
                if failure is not None:
                    self._failures.append(failure)
                if found is None:
                    if not looks or self.ready or self._failures or not self._context.ok():
                        self.wake_up()
                    self._notify_leaving()
                    if self._spinners and not self._is_shutdown:
                        self._pool.stay()

    def _go_on(self) -> Call | None:
        """The next call for this thread; another thread is woken for the rest."""
        if self._failures or not self._context.ok():
            return None
        found = self._next(0, MOST_AT_ONCE, _NOW.done)
        if found is None:
            return None
        self._begin(found[0])
        self._free -= 1
        if found[0].is_timer or (self._free and self._may_any_run()):
            self.wake_up()
        return found

    def _may_any_run(self) -> bool:
        for entity in self.ready:
            group = entity.held_group
            if group is None or group.can_execute(entity):
                return True
        if self.ready:
            self._engine.passed_over.add(self)
        return False


EventsExecutor = SingleThreadedExecutor  # in rclpy another implementation of the same
