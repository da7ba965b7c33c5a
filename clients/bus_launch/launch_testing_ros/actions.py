"""Actions for tests; programs import it as `launch_testing_ros.actions`."""

from bus_launch.launch.action import Action
from bus_launch.launch.core import LaunchContext

__all__ = ["EnableRmwIsolation"]


class EnableRmwIsolation(Action):
    """Does nothing: a bus belongs to one machine and user, and `bus test --domain N` uses a separate one."""

    def execute(self, context: LaunchContext) -> None:
        return None
