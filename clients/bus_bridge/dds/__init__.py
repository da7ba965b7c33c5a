"""The engine for DDS, as ROS 2 speaks it: of cyclonedds, with the extra `ros2`."""
