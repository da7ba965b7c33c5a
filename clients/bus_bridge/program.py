"""What runs a bridge until it is told to stop: `bus bridge zenoh`, `bus bridge ros2`."""
