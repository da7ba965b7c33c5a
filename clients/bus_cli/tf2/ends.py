"""The end of verbs that run until a signal comes."""

__all__ = ["by_signal"]


def by_signal(code: int) -> int:
    """Minus the number of the signal that ended the program, so that `bus` dies by it; else its exit status.

    The programs of tf2 themselves end with 0, as in ROS 2.
    """
    from bus_ros.rclpy import signals

    number = signals.last_signal()
    return code if number is None else -number
