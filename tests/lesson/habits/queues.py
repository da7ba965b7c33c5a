"""Queues fill while nobody spins, and spin_once takes one. Prints:

1
['8']
['8', '9']
['8', '9', 'last']
['8', '9', 'last']
"""
import time

import rclpy
from rclpy.node import Node
from std_msgs.msg import String


def until(condition):
    while not condition():
        time.sleep(0.001)


rclpy.init()
node = Node('n')
heard = []
subscription = node.create_subscription(String, 't', lambda message: heard.append(message.data), 3)
publisher = node.create_publisher(String, 't', 10)
def arrived():
    counts = subscription.native.statistics()
    return counts.queued + sum(counts.dropped.values())
print(publisher.get_subscription_count())
for number in range(10):
    publisher.publish(String(data=str(number)))
last = String(data='last')
publisher.publish(last)
last.data = 'changed'
until(lambda: arrived() == 11)
for _ in range(3):
    rclpy.spin_once(node, timeout_sec=0)
    print(heard)
rclpy.spin_once(node, timeout_sec=0)
print(heard)
