"""Launch descriptions with processes: events, respawn, output, inherited environment, tests of launches."""

import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

import bus
from bus_launch.launch import child
from bus_launch.launch.actions import (
    EmitEvent,
    ExecuteProcess,
    GroupAction,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
    SetLaunchConfiguration,
    Shutdown,
)
from bus_launch.launch.event_handlers import OnProcessExit, OnProcessIO, OnProcessStart, OnShutdown
from bus_launch.launch.events import matches_action
from bus_launch.launch.events.process import ShutdownProcess, SignalProcess
from bus_launch.launch.substitutions import LocalSubstitution
from launching import run, said, write
from programs import on_one_loop, running

PYTHON = (sys.executable, "-I", "-S", "-c")


def details(process: ExecuteProcess) -> dict[str, Any]:
    found = process.process_details
    assert found is not None
    return found


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    return tmp_path / "log"


def test_events_of_a_process(capsys: pytest.CaptureFixture[str]) -> None:
    """The tutorial's chain: each process starts when the one before has ended."""
    found: list[Any] = []
    first = ExecuteProcess(cmd=["echo", "a b"], name="first", output="screen")
    second = ExecuteProcess(cmd=["sh", "-c", "exit 3"], name="second")
    code = run(
        RegisterEventHandler(OnProcessStart(target_action=first, on_start=[LogInfo(msg="started")])),
        RegisterEventHandler(
            OnProcessIO(target_action=first, on_stdout=lambda event: found.append(event.text))
        ),
        RegisterEventHandler(
            OnProcessExit(
                target_action=first,
                on_exit=[LogInfo(msg=["code ", LocalSubstitution("event.returncode")]), second],
            )
        ),
        RegisterEventHandler(
            OnProcessExit(
                target_action=second, on_exit=lambda event, context: [LogInfo(msg=f"{event.returncode}")]
            )
        ),
        first,
    )
    out = capsys.readouterr().out
    assert code == 0
    assert said(out) == ["started", "code 0", "3"]
    assert found == [b"a b\n"]
    pids = [details(first)["pid"], details(second)["pid"]]
    assert first.return_code == 0
    names = [details(first)["name"], details(second)["name"]]
    assert [line for line in out.splitlines() if "launch.user" not in line] == [
        f"[INFO] [{names[0]}]: process started with pid [{pids[0]}]",
        f"[{names[0]}] a b",
        f"[INFO] [{names[0]}]: process has finished cleanly [pid {pids[0]}]",
        f"[INFO] [{names[1]}]: process started with pid [{pids[1]}]",
        f"[ERROR] [{names[1]}]: process has died [pid {pids[1]}, exit code 3, cmd 'sh -c exit 3'].",
    ]


def test_signals_by_events(capsys: pytest.CaptureFixture[str]) -> None:
    """The first process ends by a signal, the second as in a shutdown, the third in the shutdown of all."""
    first, second, third = (ExecuteProcess(cmd=["sleep", "1000"]) for _ in range(3))

    def when_started(process: ExecuteProcess, *actions: Any) -> RegisterEventHandler:
        return RegisterEventHandler(OnProcessStart(target_action=process, on_start=list(actions)))

    end_first = SignalProcess(signal_number="SIGTERM", process_matcher=matches_action(first))
    end_second = ShutdownProcess(process_matcher=matches_action(second))
    code = run(
        when_started(first, EmitEvent(event=end_first)),
        when_started(second, EmitEvent(event=end_second)),
        RegisterEventHandler(OnProcessExit(target_action=second, on_exit=[Shutdown()])),
        *(first, second, third),
    )
    assert code == 0
    codes = [process.return_code for process in (first, second, third)]
    assert codes == [-signal.SIGTERM, -signal.SIGINT, -signal.SIGINT]
    out = capsys.readouterr().out
    name = details(second)["name"]
    assert f"[INFO] [{name}]: sending signal 'SIGINT' to process[{name}]" in out
    assert f"[INFO] [launch]: process[{name}] was required: shutting down launched system" in out


def test_an_error_at_the_end_keeps_no_process(capsys: pytest.CaptureFixture[str]) -> None:
    process = ExecuteProcess(cmd=["sleep", "1000"])
    last = ExecuteProcess(cmd=["sleep", "1000"], sigterm_timeout="soon")
    code = run(
        process,
        RegisterEventHandler(OnShutdown(on_shutdown=lambda event, context: [][1])),
        RegisterEventHandler(OnProcessStart(target_action=process, on_start=[last])),
    )
    assert code == 1
    assert process.return_code == -signal.SIGINT
    assert last.return_code is None
    errors = [line.partition("): ")[2] for line in capsys.readouterr().out.splitlines() if "Caught" in line]
    assert errors == ["a period must be a number of seconds, not 'soon'", "list index out of range"]


def test_an_error_behind_a_process_that_was_started() -> None:
    """The process ends in order, as in any shutdown."""
    process = ExecuteProcess(cmd=["sleep", "1000"])
    assert run(GroupAction([process]), OpaqueFunction(function=lambda context: [][1])) == 1
    assert process.return_code == -signal.SIGINT


def test_without_a_guard_no_process_is_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pids: list[int] = []

    def fail(pid: int) -> None:
        pids.append(pid)
        raise BlockingIOError("no more processes")

    monkeypatch.setattr(child._guard, "add", fail)
    assert run(ExecuteProcess(cmd=["sleep", "1000"])) == 0
    assert "exception occurred while executing process: no more processes" in capsys.readouterr().out
    (pid,) = pids
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_respawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    process = ExecuteProcess(
        cmd=["sh", "-c", f"echo x >>{tmp_path}/count; exit 1"],
        respawn=True,
        respawn_delay=0.01,
        respawn_max_retries=2,
    )
    assert run(process) == 0
    assert (tmp_path / "count").read_text() == "x\n" * 3
    assert capsys.readouterr().out.count("process has died") == 3


@pytest.mark.parametrize("output", ["screen", "log", "own_log", {"stdout": "log", "stderr": "screen"}])
def test_where_output_goes(output: Any, logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    process = ExecuteProcess(
        cmd=[*PYTHON, "import sys; print('to out'); print('to err', file=sys.stderr)"],
        output=output,
        name="p",
        cached_output=True,
    )
    assert run(process) == 0
    name = details(process)["name"]
    screen = [line for line in capsys.readouterr().out.splitlines() if line.startswith(f"[{name}]")]
    both = [f"[{name}] to err", f"[{name}] to out"]
    (folder,) = (path for path in logs.iterdir() if not path.is_symlink())
    log = [
        line.partition(" ")[2] for line in (folder / "launch.log").read_text().splitlines() if " to " in line
    ]
    assert (logs / "latest").resolve() == folder
    if output == "screen":
        assert (sorted(screen), log) == (both, [])
    elif output == "own_log":
        assert (screen, log) == ([], [])
        assert (folder / f"{name}-stderr.log").read_text() == f"{both[0]}\n"
        assert sorted((folder / f"{name}.log").read_text().splitlines()) == both
    else:
        assert screen == both[:1]
        assert sorted(log) == (both if output == "log" else both[1:])
    assert (process.get_stdout(), process.get_stderr()) == ("to out\n", "to err\n")


def test_a_shell_an_environment_a_folder_a_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run(
        ExecuteProcess(cmd=["echo $A;", " pwd"], shell=True, additional_env={"A": "of a"}, output="screen"),
        ExecuteProcess(cmd=["pwd"], cwd=str(tmp_path), output="screen"),
        GroupAction(
            [
                SetEnvironmentVariable("OF_A_GROUP", "set"),
                SetLaunchConfiguration("emulate_tty", "true"),
                ExecuteProcess(
                    cmd=[*PYTHON, "import os; print(os.environ['OF_A_GROUP'], os.isatty(1))"], output="screen"
                ),
            ]
        ),
        ExecuteProcess(cmd=["/usr/bin/env"], env={"ONLY": "this"}, output="screen"),
        ExecuteProcess(
            cmd=[*PYTHON, "import os; print([os.isatty(fd) for fd in range(3)])"],
            output="screen",
            emulate_tty=True,
        ),
        ExecuteProcess(cmd=["nosuchprogram"]),
    )
    assert code == 0
    out = capsys.readouterr().out
    lines = [
        line.partition("] ")[2] for line in out.splitlines() if not line.startswith(("[INFO]", "[ERROR]"))
    ]
    assert sorted(lines) == sorted(
        ["of a", "set True", str(Path.cwd()), str(tmp_path), "ONLY=this", "[False, True, True]"]
    )
    assert "exception occurred while executing process: [Errno 2] No such file or directory: 'nosuch" in out


INHERIT = """
import subprocess, sys
import rclpy, launch_ros
from std_msgs.msg import String
print(sys.mine)
print(rclpy.__name__, String.__module__, launch_ros.__name__)
print(subprocess.run(["ros2", "--version"], capture_output=True, text=True).stdout.strip())
"""


@on_one_loop
async def test_what_children_inherit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the launch file starts Python by its name, that Python finds ROS 2's modules and a `ros2`."""
    (tmp_path / "temporary").mkdir()
    write(
        tmp_path,
        {
            "look.py": INHERIT,
            "a.launch.xml": '<launch><executable cmd="python3 $(dirname)/look.py" output="screen"/></launch>',
        },
    )
    monkeypatch.setenv(
        "PYTHONPATH", str(write(tmp_path / "user", {"sitecustomize.py": "import sys; sys.mine = 'mine'"}))
    )
    command = ("-m", "bus_cli", "launch", tmp_path / "a.launch.xml")
    async with running(tmp_path / "temporary", *command) as launch:
        assert await launch.end() == 0
    printed = [line for line in launch.lines if line.startswith("[python3-1]")]
    assert [line.removeprefix("[python3-1] ") for line in printed] == [
        "mine",
        "bus_ros.rclpy std_msgs.msg._string bus_launch.launch_ros",
        f"bus {bus.__version__}",
    ]


GENUINE = """
class LaunchService:
    def __init__(self, **kwargs): pass
"""


@on_one_loop
async def test_a_genuine_launch_is_used_where_there_is_one(tmp_path: Path) -> None:
    write(
        tmp_path,
        {
            "site/launch/__init__.py": GENUINE,
            "site/launch/launch_description_sources.py": "raise RuntimeError('the genuine one')",
            "look.py": "try:\n    import launch_ros\nexcept ImportError as error:\n    print(error)\n",
        },
    )
    site = str(tmp_path / "site")
    async with running(
        tmp_path / "site", "-m", "bus_cli", "run", tmp_path / "look.py", PYTHONPATH=site
    ) as it:
        assert await it.end() == 0
    assert it.lines == ["No module named 'launch_ros'"]
    async with running(
        tmp_path / "site", "-m", "bus_cli", "launch", "-s", tmp_path / "look.py", PYTHONPATH=site
    ) as it:
        assert await it.end() == 1
    assert it.lines[-1] == "RuntimeError: the genuine one"


LIFECYCLE = """
from launch import LaunchDescription
from launch.actions import EmitEvent, LogInfo, RegisterEventHandler, Shutdown
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition
import launch, os

def generate_launch_description():
    node = LifecycleNode(
        executable=os.path.join(os.path.dirname(__file__), "managed"), name="managed", namespace="/ns"
    )
    def change(number):
        matches = launch.events.matches_action(node)
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches, transition_id=number))
    return LaunchDescription([
        RegisterEventHandler(OnStateTransition(
            target_lifecycle_node=node, start_state="configuring", goal_state="inactive",
            entities=[LogInfo(msg="is configured"), change(Transition.TRANSITION_ACTIVATE)],
        )),
        RegisterEventHandler(OnStateTransition(
            target_lifecycle_node=node, goal_state="active", entities=[LogInfo(msg="is active"), Shutdown()],
        )),
        node,
        change(Transition.TRANSITION_CONFIGURE),
    ])
"""
MANAGED = """#!/usr/bin/env python3
import rclpy
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

class Managed(LifecycleNode):
    def on_configure(self, state):
        return TransitionCallbackReturn.SUCCESS

def main():
    rclpy.init()
    try:
        rclpy.spin(Managed("managed"))
    except KeyboardInterrupt:
        pass

main()
"""


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_a_lifecycle_node(tmp_path: Path) -> None:
    """The launch requests its transitions and receives its events by ROS 2's names."""
    folder = write(tmp_path / "here", {"managed": MANAGED, "a.launch.py": LIFECYCLE})
    (tmp_path / "temporary").mkdir()
    command = ("-m", "bus_cli", "launch", folder / "a.launch.py")
    async with running(tmp_path / "temporary", *command) as launch:
        assert await launch.end() == 0
        assert launch.family() == []
    assert said("\n".join(launch.lines)) == ["is configured", "is active"]


RESPAWNED = """
from launch import LaunchDescription
from launch.actions import EmitEvent, LogInfo, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessStart
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition
import launch, os

def generate_launch_description():
    program = os.path.join(os.path.dirname(__file__), "dying")
    node = LifecycleNode(executable=program, name="managed", namespace="/ns", respawn=True)
    configure = EmitEvent(event=ChangeState(
        lifecycle_node_matcher=launch.events.matches_action(node),
        transition_id=Transition.TRANSITION_CONFIGURE,
    ))
    return LaunchDescription([
        RegisterEventHandler(OnProcessStart(target_action=node, on_start=[configure])),
        RegisterEventHandler(OnStateTransition(
            target_lifecycle_node=node, goal_state="inactive",
            entities=[LogInfo(msg="is inactive"), Shutdown()],
        )),
        node,
    ])
"""
DIES_ONCE = """        from pathlib import Path
        died = Path(__file__).with_name("died")
        if not died.exists():
            died.touch()
            os._exit(1)
        return TransitionCallbackReturn.SUCCESS
"""


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_a_lifecycle_node_that_dies_in_a_transition(tmp_path: Path) -> None:
    """The launch says that the transition failed, and has the respawned node make the next one."""
    succeeds = "        return TransitionCallbackReturn.SUCCESS\n"
    dying = MANAGED.replace(succeeds, DIES_ONCE).replace("import rclpy\n", "import os\nimport rclpy\n", 1)
    folder = write(tmp_path / "here", {"dying": dying, "a.launch.py": RESPAWNED})
    (tmp_path / "temporary").mkdir()
    command = ("-m", "bus_cli", "launch", folder / "a.launch.py")
    async with running(tmp_path / "temporary", *command) as launch:
        assert await launch.end() == 0
    assert said("\n".join(launch.lines)) == ["is inactive"]
    failed = [line for line in launch.lines if "Failed to make transition '1'" in line]
    assert len(failed) == 1
    assert "service '/ns/managed/change_state' is not available" in failed[0]
    assert not any("Traceback" in line for line in launch.lines)


TESTED = """
import os, unittest
import launch, launch_testing, launch_testing.actions, launch_testing.asserts
from launch.actions import ExecuteProcess

def generate_test_description():
    dut = ExecuteProcess(cmd=["sh", "-c", "echo first; echo second; exec sleep 1000"], name="dut")
    return launch.LaunchDescription([dut, launch_testing.actions.ReadyToTest()]), {"dut": dut}

class TestRunning(unittest.TestCase):
    def test_output(self, dut, proc_output, proc_info):
        proc_info.assertWaitForStartup(process=dut)
        proc_output.assertWaitFor(["first", "second"], process=dut, stream="stdout")

    def test_what_does_not_hold(self):
        self.assertEqual(os.environ["WANTED"], "1")

@launch_testing.post_shutdown_test()
class TestEnded(unittest.TestCase):
    def test_code(self, proc_info):
        launch_testing.asserts.assertExitCodes(proc_info, [-2])

    def test_order(self, dut):
        with launch_testing.asserts.assertSequentialStdout(self.proc_output, dut) as stdout:
            stdout.assertInStdout("first")
            stdout.assertInStdout("second")
"""


TOPICS = """
import os, unittest
import launch, launch_ros.actions, launch_testing.actions
from launch_testing_ros import WaitForTopics
from std_msgs.msg import String

def generate_test_description():
    dut = launch_ros.actions.Node(executable=os.path.join(os.path.dirname(__file__), "talker.py"))
    return launch.LaunchDescription([dut, launch_testing.actions.ReadyToTest()])

class TestTopics(unittest.TestCase):
    def test_heard(self):
        with WaitForTopics([("chatter", String)], timeout=60.0) as topics:
            self.assertEqual(topics.received_messages("chatter")[0].data, "hi")

    def test_not_heard(self):
        topics = WaitForTopics([("nothing", String)], timeout=0.01)
        self.assertFalse(topics.wait())
        self.assertEqual(topics.topics_not_received(), {"nothing"})
        topics.shutdown()
"""
TALKER = """
import rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("talker")
publisher = node.create_publisher(String, "chatter", 10)
node.create_timer(0.05, lambda: publisher.publish(String(data="hi")))
rclpy.spin(node)
"""


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_a_test_that_waits_for_topics(tmp_path: Path) -> None:
    folder = write(tmp_path / "here", {"test_it.py": TOPICS, "talker.py": TALKER})
    (tmp_path / "temporary").mkdir()
    async with running(tmp_path / "temporary", "-m", "bus_cli", "test", folder / "test_it.py") as test:
        assert await test.end() == 0, test.lines
        assert test.family() == []
    assert "Ran 2 tests" in "\n".join(test.lines)


@pytest.mark.parametrize("wanted", ["1", "2"])
@on_one_loop
async def test_a_test_of_a_launch(tmp_path: Path, wanted: str) -> None:
    folder = write(tmp_path / "here", {"test_it.py": TESTED})
    (tmp_path / "temporary").mkdir()
    command = ("-m", "bus_cli", "test", folder / "test_it.py")
    async with running(tmp_path / "temporary", *command, WANTED=wanted) as test:
        code = await test.end()
        assert test.family() == []
    assert code == (0 if wanted == "1" else 1)
    assert [line for line in test.lines if line.startswith(("OK", "FAILED"))] == [
        "OK" if wanted == "1" else "FAILED (failures=1)",
        "OK",
    ]
