"""Ways to make publishers and subscriptions. Prints:

t0
t1
t2
t3
t4
2
3
1
"""
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
from rclpy.qos import (QoSProfile, QoSReliabilityPolicy, ReliabilityPolicy, HistoryPolicy, DurabilityPolicy,
                       qos_profile_sensor_data, qos_profile_system_default)
rclpy.init()
node = Node('n')
def callback(message): print(message.data)
profile = QoSProfile(depth=5)
profile.reliability = QoSReliabilityPolicy.BEST_EFFORT
keep_all = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
for number, qos in enumerate((10, profile, qos_profile_sensor_data, qos_profile_system_default, keep_all)):
    topic = f't{number}'
    node.create_subscription(msg_type=String, topic=topic, callback=callback, qos_profile=qos)
    node.create_publisher(msg_type=String, topic=topic, qos_profile=qos).publish(String(data=topic))
    rclpy.spin_once(node)
late = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)
latched = node.create_publisher(String, 'v', late)
for number in range(4):
    latched.publish(String(data=str(number)))
node.create_subscription(String, 'v', callback, late)
rclpy.spin_once(node)
rclpy.spin_once(node)
print(latched.get_subscription_count())
