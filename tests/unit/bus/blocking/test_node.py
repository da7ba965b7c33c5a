"""`bus.connect` before it has a connection: a Ctrl-C at any step ends it silently."""

import signal
import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "step", ["bus.node.Node.__init__", "bus.process.shared_loop.GuardedLoop.wake_on_signals"]
)
def test_a_ctrl_c_before_it_hears_signals_is_silent(step: str) -> None:
    module, _, method = step.rpartition(".")
    program = f"""
import signal
import bus, bus.process.shared_loop
signal.signal(signal.SIGINT, signal.default_int_handler)
bus.connect  # loads its module, if it is not there yet
{module}.{method} = lambda *_, **__: signal.raise_signal(signal.SIGINT)
bus.connect("early")
print("runs on")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")
