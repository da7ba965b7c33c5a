"""Parts of tests that look at topics; programs import it as `launch_testing_ros`."""

from bus_launch.launch_testing_ros import actions
from bus_launch.launch_testing_ros.wait_for_topics import WaitForTopics

__all__ = ["WaitForTopics", "actions"]
