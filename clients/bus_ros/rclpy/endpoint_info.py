"""The names of `rclpy.topic_endpoint_info` where programs of ROS 2 Rolling look for them."""

from bus_ros.rclpy.topic_endpoint_info import EndpointTypeEnum, TopicEndpointInfo

__all__ = ["EndpointTypeEnum", "TopicEndpointInfo"]
