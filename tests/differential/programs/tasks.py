"""Futures and tasks: results, errors, callbacks and cancelling."""

import rclpy
from rclpy.task import Future, Task
from show import attempt

rclpy.init()
future = Future()
print(future.done(), future.cancelled(), future.result(), future.exception())
called = []
future.add_done_callback(called.append)
future.set_result("value")
print(future.done(), future.result(), called == [future])
future.add_done_callback(called.append)
print(len(called))
attempt("another result", future.set_result, "other")
print(future.result())
failed = Future()
failed.set_exception(ValueError("wrong"))
attempt("failed", failed.result)
print(failed.done(), repr(failed.exception()))
cancelled = Future()
cancelled.cancel()
print(cancelled.done(), cancelled.cancelled())
attempt("cancelled", cancelled.result)
attempt("cancel after the end", future.cancel)
print(future.cancelled())
attempt("no callback", Future().add_done_callback, 5)
broken = Future()
broken.add_done_callback(lambda future: 1 / 0)
attempt("callback that fails", broken.set_result, 1)

task = Task(lambda one, two=0: one + two, (1,), {"two": 2})
print(task.done(), task.executing())
task()
print(task.done(), task.result())
attempt("called again", task)


async def steps(future):
    return (await future) + 1


awaited = Future()
task = Task(steps, (awaited,))
task()
print(task.done(), task.executing())
awaited.set_result(41)
task()
print(task.done(), task.result())
task = Task(steps, (awaited,))
task.cancel()
task()
print(task.done(), task.cancelled(), task.result())
task = Task(lambda: 1 / 0)
attempt("raises", task)
print(task.done(), repr(task.exception()))
attempt("raises", task.result)


attempt("repr", lambda: bool(repr(task)))
rclpy.shutdown()
