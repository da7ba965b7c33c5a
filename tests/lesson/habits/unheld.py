"""What nobody holds stays alive. Prints:

3 2 1 end
"""
import sys

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
class Counter(Node):
    def __init__(self):
        super().__init__('counter')
        self.left = 3
        self.create_publisher(String, 't', 10)
        self.create_subscription(String, 't', self.heard, 10)
        self.pub = self.create_publisher(String, 't', 10)
        self.create_timer(1, lambda: None)
        self.create_timer(0.01, self.tick)
    def tick(self):
        self.pub.publish(String())
    def heard(self, message):
        if self.left:
            print(self.left, end=' ')
            self.left -= 1
            if not self.left:
                self.create_timer(0.001, self.end)
    def end(self):
        print('end')
        sys.exit()
rclpy.init()
rclpy.spin(Counter())
