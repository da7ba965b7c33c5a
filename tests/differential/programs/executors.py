"""Executors: nodes, tasks, coroutines, time-outs and errors of callbacks."""

import threading
import time

import rclpy
from rclpy.executors import (
    ExternalShutdownException,
    MultiThreadedExecutor,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.task import Future
from show import attempt

rclpy.init()
node = rclpy.create_node("executed")
for kind in (SingleThreadedExecutor, lambda: MultiThreadedExecutor(2)):
    executor = kind()
    print(
        type(executor).__name__, executor.add_node(node), executor.add_node(node), node.executor is executor
    )
    print(len(executor.get_nodes()))
    calls = []
    timer = node.create_timer(0.01, lambda calls=calls: calls.append(None))
    executor.spin_once(timeout_sec=1.0)
    time.sleep(0.01)
    print(len(calls) <= 1)
    node.destroy_timer(timer)
    task = executor.create_task(lambda one, two: one + two, 1, two=2)
    executor.spin_until_future_complete(task, timeout_sec=5.0)
    print(task.done(), task.result())

    async def wait_for(future):
        return await future

    future = Future(executor=executor)
    waiting = executor.create_task(wait_for, future)
    executor.spin_once(timeout_sec=0.1)
    print(waiting.done())
    future.set_result("came")
    executor.spin_until_future_complete(waiting, timeout_sec=5.0)
    print(waiting.done(), waiting.result())
    never = Future()
    begun = time.monotonic()
    executor.spin_until_future_complete(never, timeout_sec=0.1)
    print(never.done(), 0.05 < time.monotonic() - begun < 5)
    guard = node.create_guard_condition(lambda calls=calls: calls.append("guard"))
    calls.clear()
    guard.trigger()
    executor.spin_once(timeout_sec=1.0)
    while "guard" not in calls:
        executor.spin_once(timeout_sec=0.1)
    print(calls)
    node.destroy_guard_condition(guard)
    attempt("nothing", executor.spin_once, timeout_sec=0.01)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    print(executor.shutdown(timeout_sec=5.0))
    thread.join(5.0)
    print(thread.is_alive(), executor.get_nodes())
    attempt("shut down", executor.spin_once, timeout_sec=0.1)
    print("after shutdown", node.executor is executor)
    node.executor = None
    print("set to None", node.executor)
attempt("no threads", MultiThreadedExecutor, 0)
for error in (ExternalShutdownException, ShutdownException, TimeoutException):
    print(error.__mro__[1].__name__, repr(str(error())))
node = rclpy.create_node("kept")
rclpy.spin_once(node, timeout_sec=0.01)
print("after spin_once", node.executor is rclpy.get_global_executor())
task = node.executor.create_task(lambda: "done")
rclpy.spin_until_future_complete(node, task, timeout_sec=5.0)
print(task.result(), node.executor is rclpy.get_global_executor())
first, second = SingleThreadedExecutor(), SingleThreadedExecutor()
print(first.add_node(node), node.executor is first, second.add_node(node), node.executor is second)
print(len(first.get_nodes()), len(second.get_nodes()))
first.remove_node(node)
print(node.executor is second, len(second.get_nodes()))
second.remove_node(node)
print("removed", node.executor is second, second.get_nodes())
node.executor = second
print("the same again", second.get_nodes())
print(second.add_node(node), len(second.get_nodes()))
node.executor = first
print(node.executor is first, len(first.get_nodes()), second.get_nodes())
node.destroy_node()
print("destroyed", node.executor is first)
other = rclpy.create_node("other")
other.executor = SingleThreadedExecutor()
executor = SingleThreadedExecutor()
with executor as entered:
    print(entered is executor)
attempt("entered", executor.spin_once, timeout_sec=0.1)
rclpy.shutdown()
