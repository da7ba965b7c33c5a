"""Messages from eight threads. Prints:

True
1600
"""
import threading

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init()
node = Node('n')
heard = []
node.create_subscription(String, 't', lambda message: heard.append(message.data), 10000)
publisher = node.create_publisher(String, 't', 10000)
def talk(name):
    for number in range(200):
        publisher.publish(String(data=f'{name} {number:03}'))
threads = [threading.Thread(target=talk, args=(name,)) for name in range(8)]
for thread in threads:
    thread.start()
while len(heard) < 1600:
    rclpy.spin_once(node)
print(all(said == sorted(said) for name in range(8) for said in [[x for x in heard if x[0] == str(name)]]))
print(len(set(heard)))
