"""A rate in a callback of many threads. Prints:

slept
"""
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
rclpy.init()
node = Node('n')
rate = node.create_rate(100)
def work():
    for _ in range(3):
        rate.sleep()
    print('slept')
    timer.cancel()
    done.set_result(None)
done = rclpy.task.Future()
timer = node.create_timer(0.01, work)
executor = MultiThreadedExecutor(num_threads=2)
executor.add_node(node)
executor.spin_until_future_complete(done)
executor.shutdown()
