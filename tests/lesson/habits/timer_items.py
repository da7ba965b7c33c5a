"""Spin_once waits, and a timer is its one item. Prints:

1 True
5
"""
import time

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init()
node = Node('n')
calls = []
begin = time.monotonic()
timer = node.create_timer(0.05, lambda: calls.append(1))
rclpy.spin_once(node)
print(len(calls), time.monotonic() - begin >= 0.049)
for _ in range(4):
    rclpy.spin_once(node)
print(len(calls))
