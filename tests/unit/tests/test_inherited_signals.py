"""Programs of tests get the signals that they need, whatever the parent of pytest ignores."""

import json
import signal
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parents[2]
INHERITED = [signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM, signal.SIGCHLD]
CHILD = """
import signal, subprocess, sys
sys.path.insert(0, sys.argv[1])
import inherited_signals
inherited_signals.restore()
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
subprocess.run([sys.executable, "-I", "-S", "-c", sys.argv[2]], check=True)
"""
GRANDCHILD = """
import json, signal
ignored = [number for number in signal.valid_signals() if signal.getsignal(number) is signal.SIG_IGN]
print(json.dumps([sorted(ignored), sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ()))]))
"""


def ignore_and_block() -> None:
    for number in INHERITED:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR1])


def test_ignored_and_blocked_signals_are_restored_for_programs() -> None:
    said = subprocess.run(
        [sys.executable, "-I", "-S", "-c", CHILD, str(TESTS), GRANDCHILD],
        capture_output=True,
        text=True,
        check=True,
        preexec_fn=ignore_and_block,
    ).stdout
    ignored_by_python = [signal.SIGPIPE, signal.SIGXFSZ]
    assert json.loads(said) == [sorted(ignored_by_python), []]
