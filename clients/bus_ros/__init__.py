"""Programs written for ROS 2, on busd: `rclpy`, classes made of definitions, and how they are started."""
