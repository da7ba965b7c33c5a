"""A separate program: ends the process groups of a launch when the launch is gone.

Reads `+GROUP` and `-GROUP` from stdin. At its end, which comes however the launch died, the groups that are
left get SIGTERM and, 5 s later, SIGKILL. Imports nothing of ours: it must start fast, and outlive an upgrade.
"""

import os
import signal
import sys
import time

_PATIENCE_S = 5.0
_LOOK_S = 0.02


def main() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    groups: set[int] = set()
    for line in sys.stdin:
        change = groups.add if line[0] == "+" else groups.discard
        change(int(line[1:]))
    groups = {group for group in groups if _send(group, signal.SIGTERM)}
    until = time.monotonic() + _PATIENCE_S
    while groups and time.monotonic() < until:
        time.sleep(_LOOK_S)
        groups = {group for group in groups if _send(group, 0)}
    for group in groups:
        _send(group, signal.SIGKILL)


def _send(group: int, number: int) -> bool:
    """Whether there was a process to send it to."""
    try:
        os.killpg(group, number)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    main()
