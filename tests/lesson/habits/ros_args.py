"""Names and parameters of the command line. Prints:

/far/new /far/b
[1.5, 'arm', 7]
arm
DEBUG
['x', 'y', 'z']
"""
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
rclpy.init(args=['x', '--ros-args', '-r', 'a:=b', '-r', '__node:=new', '-r', '__ns:=/far', '-p', 'speed:=1.5',
                 '-p', 'name:=arm', '--log-level', 'debug'])
node = Node('old')
node.declare_parameter('speed', 0.0)
node.declare_parameter('name', '')
node.declare_parameter('other', 7)
print(node.get_fully_qualified_name(), node.create_publisher(String, 'a', 1).topic_name)
print([node.get_parameter(name).value for name in ('speed', 'name', 'other')])
print(node.get_parameter('name').get_parameter_value().string_value)
print(node.get_logger().get_effective_level().name)
from rclpy.utilities import remove_ros_args
print(remove_ros_args(['x', 'y', '--ros-args', '-r', 'a:=b', '--', 'z']))
