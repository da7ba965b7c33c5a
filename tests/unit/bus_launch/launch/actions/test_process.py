"""bus_launch.launch.actions.process: the configuration of a process, and the events that it handles.

The processes are simulated by a `LaunchWorld`; tests/system/test_launch_processes.py has real ones.
"""

import asyncio
import signal
from pathlib import Path
from typing import Any

import pytest

from bus_launch.launch.actions import (
    EmitEvent,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
    SetLaunchConfiguration,
    Shutdown,
    TimerAction,
)
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.event_handlers import OnProcessExit, OnProcessIO, OnProcessStart
from bus_launch.launch.events import Shutdown as ShutdownEvent
from bus_launch.launch.events import matches_action
from bus_launch.launch.events.process import ProcessStdin, ShutdownProcess, SignalProcess
from bus_launch.launch.substitutions import LaunchConfiguration
from launch_world import LaunchWorld, ListProcess


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LaunchWorld:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.delenv("OVERRIDE_LAUNCH_PROCESS_OUTPUT", raising=False)
    return LaunchWorld(monkeypatch)


def ends_after(seconds: float, code: int = 0) -> Any:
    async def program(process: ListProcess) -> int:
        await asyncio.sleep(seconds)
        return code

    return program


def when_started(process: ExecuteProcess, *actions: Any) -> RegisterEventHandler:
    return RegisterEventHandler(OnProcessStart(target_action=process, on_start=list(actions)))


def test_an_event_for_one_process_is_not_for_another(world: LaunchWorld) -> None:
    first, second, third = (ExecuteProcess(cmd=[name]) for name in ("first", "second", "third"))
    world.ignore("second", signal.SIGUSR1)
    found: list[str] = []
    code = world.run(
        when_started(first, EmitEvent(event=ShutdownProcess(process_matcher=matches_action(first)))),
        when_started(
            second,
            EmitEvent(event=SignalProcess(signal_number="SIGUSR1", process_matcher=matches_action(second))),
        ),
        RegisterEventHandler(
            OnProcessExit(target_action=first, on_exit=lambda event, _: found.append("first"))
        ),
        *(first, second, third),
        TimerAction(period=50.0, actions=[Shutdown()]),
    )
    assert code == 0
    assert found == ["first"]
    assert [one.signals for one in world.processes] == [
        [signal.SIGINT],
        [signal.SIGUSR1, signal.SIGINT],
        [signal.SIGINT],
    ]
    assert first.return_code == -signal.SIGINT


def test_on_exit_of_one_process_is_visited_at_its_end_alone(world: LaunchWorld) -> None:
    world.program("short")(ends_after(1, code=3))
    world.program("long")(ends_after(5))
    last = ExecuteProcess(cmd=["last"], on_exit=[])
    codes: list[int] = []
    short = ExecuteProcess(cmd=["short"], on_exit=[last, TimerAction(period=10.0, actions=[Shutdown()])])
    long = ExecuteProcess(cmd=["long"], on_exit=lambda event, context: codes.append(event.returncode))
    assert world.run(short, long) == 0
    assert [one.command for one in world.processes] == [["short"], ["long"], ["last"]]
    assert round(world.processes[2].started_s - world.processes[0].started_s) == 1
    assert codes == [0]
    assert (short.return_code, long.return_code, last.return_code) == (3, 0, -signal.SIGINT)
    assert len(short.get_sub_entities()) == 2
    assert long.get_sub_entities() == []


def test_output_is_that_of_the_process_that_has_written_it(
    world: LaunchWorld, capsys: pytest.CaptureFixture[str]
) -> None:
    @world.program("talks")
    async def talks(process: ListProcess) -> int:
        process.write(b"to o")
        process.write(b"ut\nrest")
        process.write(b"to err\n", "stderr")
        await asyncio.sleep(1)
        return 0

    world.program("silent")(ends_after(1))
    talking = ExecuteProcess(cmd=["talks"], name="talks", output="screen", cached_output=True)
    silent = ExecuteProcess(cmd=["silent"], output="screen", cached_output=True)
    heard: list[bytes] = []
    code = world.run(
        RegisterEventHandler(
            OnProcessIO(target_action=talking, on_stdout=lambda event: heard.append(event.text))
        ),
        talking,
        silent,
    )
    assert code == 0
    assert b"".join(heard) == b"to out\nrest"
    assert (talking.get_stdout(), talking.get_stderr()) == ("to out\nrest", "to err\n")
    assert silent.get_stdout() == ""
    assert talking.process_details is not None
    name = talking.process_details["name"]
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith(f"[{name}]")]
    assert sorted(lines) == [f"[{name}] rest", f"[{name}] to err", f"[{name}] to out"]


def test_without_cached_output_there_is_none() -> None:
    with pytest.raises(RuntimeError, match="cached output must be true to be able to get stderr"):
        ExecuteProcess(cmd=["p"]).get_stderr()


@pytest.mark.parametrize(("respawn", "starts"), [(False, 1), (True, 3), ("$(x)", 3)])
def test_respawn(world: LaunchWorld, respawn: Any, starts: int) -> None:
    world.program("p")(ends_after(1, code=1))
    process = ExecuteProcess(
        cmd=["p"],
        respawn=LaunchConfiguration("x") if respawn == "$(x)" else respawn,
        respawn_delay=100.0,
        respawn_max_retries=2,
    )
    assert world.run(SetLaunchConfiguration("x", "true"), process) == 0
    begin = world.processes[0].started_s
    assert [round(one.started_s - begin) for one in world.processes] == [0, 101, 202][:starts]


def test_a_process_that_is_told_to_end_is_not_started_again(world: LaunchWorld) -> None:
    process = ExecuteProcess(cmd=["p"], respawn=True)
    end = EmitEvent(event=ShutdownProcess(process_matcher=matches_action(process)))
    assert world.run(process, TimerAction(period=10.0, actions=[end])) == 0
    assert len(world.processes) == 1


def test_a_program_that_is_not_there(world: LaunchWorld, capsys: pytest.CaptureFixture[str]) -> None:
    world.failing.add("p")
    process = ExecuteProcess(cmd=["p"])
    assert world.run(process) == 0
    assert process.return_code is None
    assert "exception occurred while executing process: [Errno 2]" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("by_sigint", "noninteractive", "is_said"),
    [(False, False, True), (True, False, False), (True, True, True)],
)
def test_of_a_terminals_ctrl_c_nothing_is_said(
    world: LaunchWorld,
    by_sigint: bool,
    noninteractive: bool,
    is_said: bool,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from bus_launch.launch import LaunchService

    event = ShutdownEvent(reason="", due_to_sigint=by_sigint)
    process = ExecuteProcess(cmd=["p"])
    service = LaunchService(noninteractive=noninteractive)
    assert world.run(process, when_started(process, EmitEvent(event=event)), service=service) == 0
    assert world.processes[0].signals == [signal.SIGINT]
    assert ("sending signal 'SIGINT'" in capsys.readouterr().out) is is_said


def test_how_long_it_may_take_to_end(world: LaunchWorld) -> None:
    ends: list[float] = []

    def note(context: LaunchContext) -> None:
        ends.append(asyncio.get_running_loop().time())

    for name in ("own", "shared"):
        world.ignore(name, signal.SIGINT, signal.SIGTERM)
    own = ExecuteProcess(cmd=["own"], sigterm_timeout="1", sigkill_timeout=2.0)
    shared = ExecuteProcess(cmd=["shared"])
    code = world.run(
        SetLaunchConfiguration("sigterm_timeout", "10"),
        SetLaunchConfiguration("sigkill_timeout", "20"),
        *(
            RegisterEventHandler(OnProcessExit(target_action=one, on_exit=[OpaqueFunction(function=note)]))
            for one in (own, shared)
        ),
        own,
        shared,
        OpaqueFunction(function=note),
        Shutdown(),
    )
    assert code == 0
    assert [round(end - ends[0]) for end in ends[1:]] == [3, 30]
    assert all(one.signals == [signal.SIGINT, signal.SIGTERM, signal.SIGKILL] for one in world.processes)


def test_an_action_is_executed_once(world: LaunchWorld, capsys: pytest.CaptureFixture[str]) -> None:
    process = ExecuteProcess(cmd=["p"])
    assert world.run(process, process) == 1
    assert "executed more than once" in capsys.readouterr().out


def test_nothing_is_started_once_the_launch_ends(world: LaunchWorld) -> None:
    late = ExecuteProcess(cmd=["late"])
    process = ExecuteProcess(cmd=["p"], on_exit=[late])
    assert world.run(process, TimerAction(period=1.0, actions=[Shutdown()])) == 0
    assert [one.command for one in world.processes] == [["p"]]
    assert late.get_asyncio_future() is None


def test_a_shell_gets_one_line_and_others_their_words(world: LaunchWorld) -> None:
    for name in ("echo", "ls"):
        world.program(name)(ends_after(0))
    assert (
        world.run(
            ExecuteProcess(cmd=["echo $A;", "pwd"], shell=True, additional_env={"A": "1"}),
            ExecuteProcess(cmd=["ls", "a b"], env={"ONLY": "this"}),
        )
        == 0
    )
    assert [one.command for one in world.processes] == ["echo $A; pwd", ["ls", "a b"]]
    envs = [one.env or {} for one in world.processes]
    assert (envs[0]["A"], "PATH" in envs[0], envs[1]) == ("1", True, {"ONLY": "this"})


def test_a_launch_writes_nothing_to_a_process(world: LaunchWorld, capsys: pytest.CaptureFixture[str]) -> None:
    process = ExecuteProcess(cmd=["p"])
    details = {"action": process, "name": "p-7", "cmd": ["p"], "cwd": None, "env": None}
    world.run(
        process,
        EmitEvent(event=ProcessStdin(text=b"x", **details)),
        TimerAction(period=1.0, actions=[Shutdown()]),
    )
    assert "[WARNING] [p-7]: a launch writes nothing to a process" in capsys.readouterr().out
