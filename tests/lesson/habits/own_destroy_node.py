"""A node's own destroy_node runs as often as the program calls it: not again at the end. Prints:

destroyed
"""
import rclpy
from example_interfaces.action import Fibonacci
from rclpy.action import ActionClient
from rclpy.node import Node
class Commander(Node):
    def __init__(self, name):
        super().__init__(name)
        self.action_client = ActionClient(self, Fibonacci, 'fibonacci')
    def destroy_node(self):
        self.action_client.destroy()
        super().destroy_node()
        print('destroyed')
rclpy.init()
commander, left_open = Commander('commander'), Commander('left_open')
commander.destroy_node()
