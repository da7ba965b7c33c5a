"""The second Ctrl-C: if the first one is still ending a program, the second ends it at once and prints
nothing.
"""

import signal
import subprocess
import sys

import pytest

FIRST_AND_SECOND = """\
import atexit, signal
import bus.process.termination as termination
termination.say_nothing_of_signals()
atexit.register(print, "went on", flush=True)
atexit.register(signal.raise_signal, signal.SIGINT)
raise {error}
"""
AT_ONCE = """\
import signal
import bus.process.termination as termination
{before}
termination.die_at_interrupt()
signal.raise_signal(signal.SIGINT)
print("went on", flush=True)
"""


def ended(text: str) -> tuple[int, str, str]:
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("error", ["KeyboardInterrupt", "termination.Terminated"])
def test_one_more_while_a_program_ends(error: str) -> None:
    assert ended(FIRST_AND_SECOND.format(error=error)) == (-signal.SIGINT, "", "")


def test_no_exception_is_made_of_it() -> None:
    assert ended(AT_ONCE.format(before="")) == (-signal.SIGINT, "", "")


def test_where_it_is_ignored_it_stays_so() -> None:
    before = "signal.signal(signal.SIGINT, signal.SIG_IGN)"
    assert ended(AT_ONCE.format(before=before)) == (0, "went on\n", "")
