"""The process of a recorder."""

import os
import subprocess
import sys

import pytest

_PROGRAM = "import os; from bus_bag.record.program import settle_process; settle_process(); \
print(os.sched_getscheduler(0))"


@pytest.mark.skipif(sys.platform != "linux", reason="other kernels have no such policy")
def test_it_takes_no_cpu_from_a_publisher_that_runs() -> None:
    found = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=True)
    assert int(found.stdout) == os.SCHED_BATCH
