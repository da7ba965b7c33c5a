"""The kinds of clocks; numbers are those of rcl_clock_type_t. Knows nothing else."""

from enum import IntEnum

__all__ = ["ClockType"]


class ClockType(IntEnum):
    """What a clock's time is counted from, and whether it can jump."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    """As SYSTEM_TIME, or the simulation's time while `use_sim_time` is set."""
    SYSTEM_TIME = 2
    """Since 1970; jumps when the machine's date is set."""
    STEADY_TIME = 3
    """Since some moment in the past; never jumps."""
