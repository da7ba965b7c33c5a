"""Actions for tests; programs import it as `launch_pytest.actions`."""

from bus_launch.launch_testing.actions import ReadyToTest

__all__ = ["ReadyToTest"]
