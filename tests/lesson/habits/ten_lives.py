"""Init and shutdown, ten times. Prints:

11 True False
"""
import os
import threading

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
def look():
    links = [os.readlink(f'/proc/self/fd/{name}') for name in os.listdir('/proc/self/fd')
             if os.path.exists(f'/proc/self/fd/{name}')]
    return len(links), threading.active_count()
def live():
    with rclpy.init():
        node = Node('n')
        node.create_subscription(String, 't', heard.append, 10)
        node.create_publisher(String, 't', 10).publish(String())
        rclpy.spin_once(node)
        node.destroy_node()
heard = []
live()
before = look()
for _ in range(10):
    live()
print(len(heard), look() == before or (before, look()), rclpy.ok())
