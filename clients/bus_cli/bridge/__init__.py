"""`bus bridge`: the bus of this machine joined with those of others, and with ROS 2."""
