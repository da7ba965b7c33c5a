"""A loop of spin_once. Prints:

3
"""
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init()
node = Node('n')
count = 0
def tick():
    global count
    count += 1
    if count == 3:
        rclpy.shutdown()
node.create_timer(0.01, tick)
while rclpy.ok():
    rclpy.spin_once(node, timeout_sec=0.1)
print(count)
