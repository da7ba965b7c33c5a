"""The name of this program for usage lines and errors: `bus`, or `ros2` after `bus ros2 install`."""

import os
import sys

__all__ = ["ALIAS", "NAME", "program_name"]

NAME = "bus"
ALIAS = "ros2"


def program_name() -> str:
    """The name under which the user has started this process."""
    started = os.path.basename(sys.argv[0]) if sys.argv else ""  # noqa: PTH119 (for a short start)
    return ALIAS if started == ALIAS else NAME
