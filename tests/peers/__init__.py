"""Programs that are no busd, with which bridges must get on: ROS 2's rclpy, plain cyclonedds, plain zenoh.

`peer.py` starts one and talks with it; `programs/` has what runs there, each under the Python that has its
library. All understand the same orders, as far as they have what is asked for.
"""
