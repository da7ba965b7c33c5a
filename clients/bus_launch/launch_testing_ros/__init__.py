"""Parts of tests that look at topics; programs import it as `launch_testing_ros`.

`wait_for_topics.py` waits for messages, with a separate context and node; `actions.py` has actions for
tests.

Read first: `wait_for_topics.py`. Tests: `tests/system/test_launch_processes.py`.
"""

from bus_launch.launch_testing_ros import actions
from bus_launch.launch_testing_ros.wait_for_topics import WaitForTopics

__all__ = ["WaitForTopics", "actions"]
