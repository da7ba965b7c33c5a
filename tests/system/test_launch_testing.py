"""launch_testing: processes that tests start, limits of time, and the ways to run a file of tests."""

import re
import sys
from pathlib import Path

import pytest

from bus_cli.exitcodes import EXIT_ERROR
from cli import Result
from packaged import run_bus

TESTED = """
import sys, unittest
import launch, launch_testing, launch_testing.actions, launch_testing.asserts, launch_testing.tools
import pytest
from launch.actions import ExecuteProcess
from launch_testing.asserts import EXIT_SIGINT, assertExitCodes, assertInStream

SCRIPT = "print('up', flush=True); print('word: ' + input(), flush=True)"

@pytest.mark.launch_test
@launch_testing.parametrize("word", ["one", "two"])
def generate_test_description(word):
    return launch.LaunchDescription([
        launch_testing.util.KeepAliveProc(), launch_testing.actions.ReadyToTest()
    ]), {"word": word}

class TestTools(unittest.TestCase):
    def test_one_that_ends(self, launch_service, proc_info, proc_output, word):
        process = ExecuteProcess(cmd=["sh", "-c", f"echo {word}; exit 3"])
        with launch_testing.tools.launch_process(launch_service, process, proc_info, proc_output) as proxy:
            assert proxy.wait_for_shutdown(timeout=60)
            assert proxy.terminated and not proxy.running
            assert (proxy.stdout, proxy.stderr, proxy.exit_code) == (f"{word}\\n", "", 3)
            assert launch_testing.tools.expect_output(proxy.output, expected_lines=[word], strict=True)

    def test_one_that_is_ended(self, launch_service, proc_info, proc_output):
        process = ExecuteProcess(cmd=["sh", "-c", "echo up >&2; exec sleep 1000"])
        with launch_testing.tools.launch_process(
            launch_service, process, proc_info, proc_output, output_filter=str.upper
        ) as proxy:
            found = proxy.wait_for_output(lambda output: "UP" in output, timeout=60)
            assert found, found
            assert proxy.running
            assertInStream(proc_output, "up", process)
        assert proxy.wait_for_shutdown(timeout=60)
        assertExitCodes(proc_info, [EXIT_SIGINT], process)
"""
LATE = """
import launch, launch_testing, launch_testing.actions, unittest
from launch.actions import TimerAction

@launch_testing.ready_to_test_action_timeout(0.1)
def generate_test_description():
    ready = launch_testing.actions.ReadyToTest()
    return launch.LaunchDescription([TimerAction(period=1000.0, actions=[ready])])

class TestNothing(unittest.TestCase):
    def test_it(self):
        pass
"""
TEST_ACTIONS = """
import sys
import launch, launch_testing.actions, launch_testing.event_handlers
from launch.actions import ExecuteProcess, LogInfo, RegisterEventHandler

def generate_launch_description():
    slow = launch_testing.actions.GTest(path="./slow", timeout=0.2, name="slow")
    ready = launch_testing.event_handlers.StdoutReadyListener(
        target_action=slow, ready_txt="here", actions=[LogInfo(msg="it is ready")]
    )
    return launch.LaunchDescription([
        RegisterEventHandler(ready), slow,
        launch_testing.actions.PyTest(path="test_passes.py", timeout=1000.0, name="passes"),
    ])
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "test_tools.py").write_text(TESTED)
    return tmp_path


def ended(result: Result, code: int, *said: str) -> None:
    assert result.code == code, result.out + result.err
    for text in said:
        assert re.search(text, result.out + result.err), result.out + result.err


def test_processes_that_a_test_starts(here: Path) -> None:
    """The file has two launches, each with two tests."""
    result = run_bus("test", "test_tools.py")
    ended(result, 0)
    assert result.err.count("Ran 2 tests") == 2


def test_as_a_module(here: Path) -> None:
    ended(run_bus("run", "-m", "launch_testing.launch_test", "test_tools.py"), 0, "Ran 2 tests")


@pytest.mark.parametrize(("expected", "code"), [("3", 0), ("4", 1)])
def test_in_pytest(here: Path, expected: str, code: int) -> None:
    """A file with the mark is one test; other files are pytest's own."""
    (here / "test_tools.py").write_text(TESTED.replace('"", 3)', f'"", {expected})'))
    (here / "test_other.py").write_text("def test_it(): pass\n")
    options = ("-q", "-p", "no:cacheprovider", "-p", "launch_testing.pytest.hooks", "--rootdir", str(here))
    result = run_bus("run", "-m", "pytest", *options, "test_tools.py", "test_other.py")
    said = ("FAIL: test_tools.TestTools.test_one_that_ends", "1 failed, 1 passed") if code else ("2 passed",)
    ended(result, code, *said)


def test_a_launch_that_is_not_ready_in_time(here: Path) -> None:
    (here / "late.py").write_text(LATE)
    ended(run_bus("test", "late.py"), EXIT_ERROR, r"Timed out waiting for .* not ready after 0\.1 s")


def test_actions_that_run_tests(here: Path) -> None:
    (here / "tests.launch.py").write_text(TEST_ACTIONS)
    (here / "slow").write_text("#!/bin/sh\necho here\nexec sleep 1000\n")
    (here / "slow").chmod(0o755)
    (here / "test_passes.py").write_text("def test_it(): pass\n")
    result = run_bus("launch", "tests.launch.py", PYTHONPATH=":".join(filter(None, sys.path)))
    ended(result, 0, "it is ready", r"slow-1\]: process has died .* exit code -2", r"passes-2\]: .* cleanly")
