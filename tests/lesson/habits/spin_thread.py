"""A thread that spins beside the main loop. Prints:

['x']
"""
import threading

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init()
node = Node('n')
heard = []
node.create_subscription(String, 't', lambda message: heard.append(message.data), 10)
publisher = node.create_publisher(String, 't', 10)
thread = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
thread.start()
rate = node.create_rate(100)
while len(heard) < 5:
    publisher.publish(String(data='x'))
    rate.sleep()
rclpy.shutdown()
thread.join()
print(sorted(set(heard)))
