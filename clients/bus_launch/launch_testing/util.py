"""Parts of test descriptions; programs import it as `launch_testing.util`."""

import sys
from typing import Any

from bus_launch.launch.actions import ExecuteProcess
from bus_launch.launch_testing.actions import ReadyToTest
from bus_launch.launch_testing.lookup import NO_CMD_ARGS, NoMatchingProcessException, resolveProcesses

__all__ = ["NO_CMD_ARGS", "KeepAliveProc", "NoMatchingProcessException", "ReadyToTest", "resolveProcesses"]

__path__: list[str] = []  # in ROS 2, it has a module proc_lookup


class KeepAliveProc(ExecuteProcess):
    """A process that does nothing and ends with the launch. It keeps a launch without others running."""

    def __init__(self, **kwargs: Any) -> None:
        script = "import signal; signal.signal(signal.SIGINT, lambda *_: None); signal.pause()"
        super().__init__(cmd=[sys.executable, "-I", "-S", "-c", script], **kwargs)
