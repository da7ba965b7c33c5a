"""rclpy's futures in tasks of asyncio: gather, wait_for, and an executor that spins there."""

import asyncio
import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from show import name_of
from test_msgs.srv import BasicTypes


def serve(request, response):
    response.int32_value = request.int32_value + 1
    return response


async def spin(executor, is_over):
    while not is_over():
        executor.spin_once(timeout_sec=0.01)
        await asyncio.sleep(0.001)


async def plus_one(client, number):
    request = BasicTypes.Request(int32_value=number)
    return (await client.call_async(request)).int32_value


async def callback(client, number):
    """In the executor: a callback awaits the answer of a service."""
    return "callback", await plus_one(client, number)


async def main(node):
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    group = rclpy.callback_groups.ReentrantCallbackGroup()
    node.create_service(BasicTypes, "plus_one", serve, callback_group=group)
    client = node.create_client(BasicTypes, "plus_one", callback_group=group)
    client.wait_for_service()
    is_over = threading.Event()
    spinning = asyncio.create_task(spin(executor, is_over.is_set))
    print(await asyncio.gather(*(plus_one(client, number) for number in range(3))))
    print(await asyncio.wait_for(plus_one(client, 3), 10.0))
    print(await executor.create_task(callback, client, 4))
    never = Future()
    try:
        await asyncio.wait_for(never, 0.05)
    except TimeoutError as error:
        print(name_of(error), never.done(), never.cancelled())
    failed = Future()
    asyncio.get_running_loop().call_soon(failed.set_exception, ValueError("wrong"))
    try:
        await failed
    except ValueError as error:
        print(name_of(error), error)
    late = Future()
    thread = threading.Timer(0.05, late.set_result, ["late"])
    thread.start()
    print(await late)
    is_over.set()
    await spinning


rclpy.init()
node = rclpy.create_node("waiter")
asyncio.run(main(node))
node.destroy_node()
rclpy.shutdown()
