"""launch_testing.runner: which tests decide, in launches without processes."""

import unittest
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import pytest

from bus_launch.launch import logging
from bus_launch.launch.actions import TimerAction
from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch_testing import parametrize, post_shutdown_test
from bus_launch.launch_testing.actions import ReadyToTest
from bus_launch.launch_testing.runner import run_module
from rows import for_each


def module_of(before: Sequence[bool], after: bool) -> ModuleType:
    """A test file with a launch for each item of `before`: whether its test passes during the launch."""
    made = ModuleType("a_test_file")

    class Before(unittest.TestCase):
        def test_row(self, passes: bool) -> None:
            self.assertTrue(passes)

    class After(unittest.TestCase):
        def test_end(self) -> None:
            self.assertTrue(after)

    @parametrize("passes", list(before))
    def generate_test_description(passes: bool) -> LaunchDescription:
        return LaunchDescription([ReadyToTest()])

    for one in (Before, post_shutdown_test()(After)):
        one.__module__ = made.__name__
        setattr(made, one.__name__, one)
    made.generate_test_description = generate_test_description  # type: ignore[attr-defined]
    return made


@for_each(
    ("before", "after", "passes"),
    [
        ([True], True, True),
        ([True, True], True, True),
        ([True, False], True, False),
        ([False, True], True, False),
        ([True], False, False),
    ],
)
def test_all_tests_of_all_launches_decide(
    before: list[bool], after: bool, passes: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    ended: list[unittest.TestResult] = []

    def run(suite: unittest.TestSuite) -> unittest.TestResult:
        ended.append(suite.run(unittest.TestResult()))
        return ended[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_LOG_DIR", str(tmp_path_factory.mktemp("log")))
        logging.reset()
        assert run_module(module_of(before, after), {}, run) is passes
    logging.reset()
    assert len(ended) == 2 * len(before), "no launch is left out after a failure"


def test_an_error_of_a_test_file_ends_its_launch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    module = ModuleType("a_test_file")
    description = LaunchDescription([ReadyToTest(), TimerAction(period=1000.0, actions=[])])
    module.generate_test_description = lambda: description  # type: ignore[attr-defined]

    class Before(unittest.TestCase):
        setUpClass = None  # type: ignore[assignment]

        def test_it(self) -> None:
            """Never called."""

    Before.__module__ = module.__name__
    module.Before = Before  # type: ignore[attr-defined]
    logging.reset()
    with pytest.raises(TypeError, match="None is not a callable object"):
        run_module(module, {}, lambda suite: suite.run(unittest.TestResult()))
    logging.reset()
