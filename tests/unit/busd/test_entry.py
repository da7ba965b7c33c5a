"""busd.entry: a Ctrl-C while busd's modules are loaded ends the process by the signal, silently."""

import signal
import subprocess
import sys

import pytest

PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.{handler})
class Finder:
    def find_spec(name, path=None, target=None):
        if name == "busd.run":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Finder)
import busd.entry
print("runs on")
"""


@pytest.mark.parametrize(
    ("handler", "status", "said"),
    [("default_int_handler", -signal.SIGINT, ""), ("SIG_IGN", 0, "runs on\n")],
)
def test_a_ctrl_c_while_it_is_loaded(handler: str, status: int, said: str) -> None:
    command = [sys.executable, "-c", PROGRAM.format(handler=handler)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (status, said, "")
