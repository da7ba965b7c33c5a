"""Submodules are attributes. Prints:

qos executors duration time parameter callback_groups logging context utilities
True
True 1
True True
"""
import sys
import time

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
parts = ('qos', 'executors', 'duration', 'time', 'parameter', 'callback_groups', 'logging', 'context',
         'utilities')
print(*(getattr(rclpy, part).__name__.rpartition('.')[2] for part in parts))
from rclpy import qos
print(qos is rclpy.qos)
print(rclpy.Parameter is rclpy.parameter.Parameter, rclpy.time.Duration(seconds=1).nanoseconds // 10**9)
import rclpy.qos as same
print(same is qos, sys.modules['rclpy.qos'] is qos)
