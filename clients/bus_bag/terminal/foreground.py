"""Checks whether this program is in the foreground of its terminal."""

import errno
import os

__all__ = ["is_in_foreground"]


def is_in_foreground(terminal: int) -> bool:
    """Whether this program may use a terminal. In the background, use would stop the program, or disturb
    others."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError as error:
        return error.errno == errno.ENOTTY  # ENOTTY: no shell uses it; other errors: it has gone
