"""Tests of launch files as pytest's functions; programs import it as `launch_pytest`.

A fixture returns a launch description, and tests name it by a mark: they run while the launch runs, or after
it. `fixture.py` decorates the fixture, `plugin.py` has pytest's hooks, `run.py` runs the launch of a fixture,
`tools/` waits for processes.

Invariants: the launch has the main thread and a separate loop. It only makes progress while a test or a
fixture waits for it. Names and texts are ROS 2's.

The plugin is loaded by `-p launch_pytest.plugin`. It is not needed to import this package.

Read first: `plugin.py`. Tests: `tests/system/test_launch_pytest.py`.
"""

from bus_launch.launch_pytest import actions, tools
from bus_launch.launch_pytest.fixture import fixture

__all__ = ["actions", "fixture", "tools"]
