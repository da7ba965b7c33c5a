"""The controlling terminal of this process, and whether its end is the end of the process (SIGHUP)."""

import os
import signal

__all__ = ["ends_with_terminal", "has_terminal"]


def has_terminal() -> bool:
    """Whether this process has a controlling terminal that is still there."""
    try:
        os.close(os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC))
    except OSError:
        return False
    return True


def ends_with_terminal() -> bool:
    """Whether this process is to end with its terminal: it has one, and does not run under nohup."""
    return has_terminal() and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
