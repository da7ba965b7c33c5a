"""Tools for tests with processes; programs import it as `launch_testing.tools`.

`process.py` starts a process within a test, `output.py` compares its output.

Read first: `process.py`. Tests: `tests/unit/bus_launch/launch_testing/tools/`,
`tests/system/test_launch_processes.py`.
"""

from bus_launch.launch_testing.tools.output import (
    basic_output_filter,
    expect_output,
    expected_output_from_file,
)
from bus_launch.launch_testing.tools.process import ProcessProxy, launch_process

__all__ = [
    "ProcessProxy",
    "basic_output_filter",
    "expect_output",
    "expected_output_from_file",
    "launch_process",
]
