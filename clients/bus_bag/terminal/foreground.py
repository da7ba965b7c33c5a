"""Whether this program is in the foreground of its terminal."""

import errno
import os

__all__ = ["is_in_foreground"]


def is_in_foreground(terminal: int) -> bool:
    """Whether this program may use a terminal; in the background that would stop it, or disturb others."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError as error:
        return error.errno == errno.ENOTTY  # no shell's, which has a foreground; else it has gone
