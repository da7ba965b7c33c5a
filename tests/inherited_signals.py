"""Signals that a process inherits from its parent, and passes to its children: ignored and blocked ones."""

import os
import signal

__all__ = ["restore"]

_PYTHON_IGNORES = {signal.SIGPIPE, signal.SIGXFSZ}
"""The interpreter ignores these for itself; `subprocess` restores them for a child."""


def restore() -> None:
    """Restore the actions that signals have in a terminal's shell, for this process and its programs.

    `nohup`, cron and CI runners start a program with ignored signals. If there were any, a worker of
    pytest-xdist gets a separate process group: the end of the terminal must not end a run under `nohup`.
    """
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    ignored = {number for number in signal.valid_signals() if signal.getsignal(number) is signal.SIG_IGN}
    ignored -= _PYTHON_IGNORES
    for number in ignored:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    if ignored and "PYTEST_XDIST_WORKER" in os.environ:
        os.setpgid(0, 0)
