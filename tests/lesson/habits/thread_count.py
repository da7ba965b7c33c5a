"""As many threads as there are CPUs. Prints:

0
free
"""
import os
import threading
import time

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


def until(condition):
    while not condition():
        time.sleep(0.001)


from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
rclpy.init()
os.sched_getaffinity = lambda _: {0, 1}
node = Node('n')
executor = MultiThreadedExecutor()
executor.add_node(node)
group = ReentrantCallbackGroup()
held, free = threading.Barrier(3), threading.Event()
def hold():
    held.wait()
    free.wait()
holders = [node.create_timer(0.001, hold, callback_group=group) for _ in range(2)]
ticks = []
threading.Thread(target=executor.spin, daemon=True).start()
held.wait()
late = node.create_timer(0.001, lambda: ticks.append(1), callback_group=group)
until(lambda: late.time_until_next_call() < -50_000_000)
print(len(ticks))
for holder in holders:
    holder.cancel()
free.set()
until(lambda: ticks)
print('free')
executor.shutdown()
