"""Spin_once and a rate in one thread. Prints:

5
"""
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init()
node = Node('n')
calls = []
node.create_timer(0.001, lambda: calls.append(1))
rate = node.create_rate(200)
for _ in range(5):
    rclpy.spin_once(node)
    rate.sleep()
print(len(calls))
