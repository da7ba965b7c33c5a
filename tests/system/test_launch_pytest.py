"""launch_pytest: tests during a launch and after it, in every form, their order, and mistakes."""

import re
from pathlib import Path

import pytest

from cli import Result
from packaged import run_bus

HEAD = """
import launch, launch_pytest, pytest
from launch.actions import ExecuteProcess
from launch_pytest import tools
"""
PROCESS = (
    HEAD
    + """
@pytest.fixture
def dut():
    return ExecuteProcess(cmd=["sh", "-c", "echo up; echo low >&2; exec sleep 1000"], cached_output=True)

@launch_pytest.fixture
def description(dut):
    return launch.LaunchDescription([dut, launch_pytest.actions.ReadyToTest()])

def has_up(text):
    assert text == "up\\n"

@pytest.mark.launch(fixture=description)
def test_function(dut, launch_context):
    assert tools.wait_for_start_sync(launch_context, dut, timeout=60)
    tools.assert_output_sync(launch_context, dut, has_up, timeout=60)
    assert tools.wait_for_stderr_sync(launch_context, dut, lambda text: text == "low\\n", timeout=60)
    assert not tools.wait_for_output_sync(launch_context, dut, lambda text: False, timeout=0.01)
    with pytest.raises(AssertionError):
        tools.assert_stderr_sync(launch_context, dut, has_up, timeout=0.01)
    assert not tools.wait_for_exit_sync(launch_context, dut, timeout=0.01)
    yield
    assert dut.return_code == -2

@pytest.mark.launch(fixture=description)
async def test_coroutine(dut, launch_context, launch_service, event_loop):
    assert await tools.wait_for_start(launch_context, dut, timeout=60)
    await tools.assert_output(launch_context, dut, has_up, timeout=60)
    assert await tools.wait_for_stderr(launch_context, dut, lambda text: text == "low\\n", timeout=60)
    assert not await tools.wait_for_exit(launch_context, dut, timeout=0.01)
    with pytest.raises(AssertionError):
        await tools.assert_stderr(launch_context, dut, has_up, timeout=0.01)
    assert launch_service.event_loop is event_loop
    yield
    assert await tools.wait_for_exit(launch_context, dut, timeout=0.01)

@pytest.mark.launch(fixture=description, shutdown=True)
def test_after(dut):
    assert dut.return_code == -2
"""
)
ORDER = (
    HEAD
    + """
ORDER = []

@launch_pytest.fixture(scope="module", params=["a", "b"])
def shared(request):
    ORDER.append(f"launch {request.param}")
    return launch.LaunchDescription([ExecuteProcess(cmd=["sleep", "1000"])]), request.param

@pytest.mark.launch(fixture=shared, shutdown=True)
def test_after(shared, launch_service):
    assert launch_service.event_loop is None
    ORDER.append(f"after {shared[1]}")

@pytest.mark.launch(fixture=shared)
@pytest.mark.parametrize("number", [1, 2])
async def test_parts(shared, number, launch_service):
    assert launch_service.event_loop is not None
    ORDER.append(f"{number} during {shared[1]}")
    yield
    assert launch_service.event_loop is None
    ORDER.append(f"{number} after {shared[1]}")

class TestMethods:
    @pytest.mark.launch(fixture=shared)
    def test_method(self, shared):
        ORDER.append(f"method {shared[1]}")

def test_order():
    expected = []
    for one in "ab":
        expected += [f"launch {one}", f"1 during {one}", f"2 during {one}", f"method {one}"]
        expected += [f"after {one}", f"1 after {one}", f"2 after {one}"]
    assert ORDER == expected
"""
)
MISTAKES = (
    HEAD
    + """
@launch_pytest.fixture
def nothing():
    return 5

@launch_pytest.fixture
def twice():
    return launch.LaunchDescription([launch_pytest.actions.ReadyToTest()] * 2)

@launch_pytest.fixture
def failing():
    return launch.LaunchDescription([
        launch_pytest.actions.ReadyToTest(), launch.actions.OpaqueFunction(function=lambda context: 1 / 0),
    ])

@launch_pytest.fixture
def early():
    return launch.LaunchDescription([launch.actions.Shutdown(), launch.actions.TimerAction(
        period=1000.0, actions=[launch_pytest.actions.ReadyToTest()]
    )])

@launch_pytest.fixture(scope="module")
def good():
    return launch.LaunchDescription([])

@pytest.mark.launch(fixture=nothing)
def test_no_description(): pass

@pytest.mark.launch(fixture=twice)
def test_two_ready(): pass

@pytest.mark.launch(fixture=failing)
def test_failed_launch(): pass

@pytest.mark.launch(fixture=early)
def test_never_ready(): pass

@pytest.mark.launch(fixture=good)
def test_two_yields():
    yield
    yield

@pytest.mark.launch(fixture=good)
def test_failed_before():
    assert 1 == 2
    yield

@pytest.mark.launch(fixture=good, shutdown=True)
def test_parts_after():
    yield

@pytest.mark.launch
def test_no_fixture():
    assert False

def test_not_a_launch(launch_service): pass
"""
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(here: Path, text: str) -> Result:
    (here / "test_it.py").write_text(text)
    options = ("-q", "-rfEs", "-p", "no:cacheprovider", "-p", "launch_pytest.plugin", "--rootdir", str(here))
    return run_bus("run", "-m", "pytest", *options, "test_it.py")


def test_during_a_launch_and_after_it(here: Path) -> None:
    result = run(here, PROCESS)
    assert result.code == 0, result.out
    assert "3 passed" in result.out


def test_order_of_tests_with_one_launch(here: Path) -> None:
    result = run(here, ORDER)
    assert result.code == 0, result.out
    assert "13 passed" in result.out


def test_mistakes(here: Path) -> None:
    result = run(here, MISTAKES)
    for text in (
        r"TypeError: launch_pytest fixture 'nothing': return value must be either a launch description or a "
        r"sequence that begins with one, not 5",
        r"RuntimeError: launch_pytest fixture 'twice': .* only one ReadyToTest action, not 2",
        r"RuntimeError: launch_pytest fixture 'failing': the launch ended with return code 1",
        r"RuntimeError: launch_pytest fixture 'early': the launch ended before it was ready for tests",
        r"must stop iteration after yielding once",
        r"cannot be marked with shutdown=True",
        r'"fixture" keyword argument is required in a pytest.mark.launch\(\) decorator',
        r"'launch_service' needs a test with @pytest.mark.launch\(fixture=...\)",
        r"shutdown test skipped because the test failed before",
    ):
        assert re.search(text, result.out), (text, result.out)
    assert "assert 1 == 2" in result.out


EXIT = (
    HEAD
    + """
@launch_pytest.fixture
def description():
    return launch.LaunchDescription([ExecuteProcess(cmd=["sleep", "1000"])])

@pytest.mark.launch(fixture=description)
def test_exit():
    raise SystemExit(3)

@pytest.mark.launch(fixture=description)
async def test_exit_of_a_coroutine():
    raise SystemExit(4)
"""
)


def test_a_test_that_exits_fails(here: Path) -> None:
    result = run(here, EXIT)
    assert "SystemExit: 3" in result.out and "SystemExit: 4" in result.out, result.out
    assert "2 failed" in result.out
