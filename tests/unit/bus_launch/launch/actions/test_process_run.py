"""bus_launch.launch.actions.process_run: the events that lead from state to state, without a process."""

import asyncio
import signal
from pathlib import Path
from typing import Any

import pytest

from bus_launch.launch.actions.process_lines import ProcessLines
from bus_launch.launch.actions.process_run import ProcessRun
from bus_launch.launch.actions.process_state import ProcessState
from bus_launch.launch.core import LaunchContext
from bus_launch.launch.logging import get_logger
from jumping_loop import play
from launch_world import ListProcess

STARTING, UNWANTED, RUNNING, ENDING, WAITING, ENDED = ProcessState
NAME = "p-1"


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))


class Scene:
    """A run whose process has reached a state."""

    def __init__(
        self,
        *,
        respawns: int = 0,
        respawn_delay_s: float = 10.0,
        ignores: tuple[signal.Signals, ...] = (),
        fails: int = 0,
        error: Exception | None = None,
    ) -> None:
        """The first `fails` starts fail with `error`."""
        self.context = LaunchContext()
        self.processes: list[ListProcess] = []
        self.fails = fails
        self.error = error or FileNotFoundError("no such program")
        self.ignores = ignores
        logger = get_logger(NAME)
        details = {"action": None, "name": NAME, "cmd": ["p", " ", "x"], "cwd": None, "env": None}
        self.run = ProcessRun(
            self.context,
            details,
            self.start,
            ProcessLines((logger, logger), "{}".format, keep=True),
            patience_s=(5.0, 7.0),
            respawns=respawns,
            respawn_delay_s=respawn_delay_s,
        )

    def start(self) -> ListProcess:
        if self.fails:
            self.fails -= 1
            raise self.error
        process = ListProcess(["p"], 100 + len(self.processes), env=None, ignores=self.ignores, program=None)
        self.processes.append(process)
        return process

    def events(self) -> list[str]:
        """The kinds of the events emitted since the last call."""
        found = []
        queue = self.context._event_queue
        while not queue.empty():
            found.append(type(queue.get_nowait()).__name__)
            queue.task_done()
        return found

    async def come_to(self, state: ProcessState) -> "Scene":
        if state in (UNWANTED, ENDING):
            self.run.end(says_so=True)
        if state in (RUNNING, ENDING, WAITING, ENDED):
            await asyncio.sleep(0)
            await asyncio.sleep(0)
        if state in (WAITING, ENDED):
            self.processes[-1].exit(0)
            await asyncio.sleep(1)
        assert self.run.state is state
        return self

    async def exit(self) -> None:
        self.processes[-1].exit(0)
        await asyncio.sleep(1)

    async def end(self) -> None:
        self.run.end(says_so=True)
        await asyncio.sleep(1)

    async def wait(self) -> None:
        await asyncio.sleep(11)


@pytest.mark.parametrize(
    ("state", "makes", "happens", "following"),
    [
        (STARTING, {}, None, RUNNING),
        (STARTING, {"fails": 1, "respawns": 1}, None, WAITING),
        (STARTING, {"fails": 1}, None, ENDED),
        (STARTING, {"ignores": (signal.SIGINT,)}, Scene.end, ENDING),
        (UNWANTED, {"fails": 1, "respawns": 1}, Scene.end, ENDED),
        (UNWANTED, {}, None, ENDED),  # started, interrupted, and ended
        (RUNNING, {}, Scene.exit, ENDED),
        (RUNNING, {"respawns": 1}, Scene.exit, WAITING),
        (RUNNING, {"ignores": (signal.SIGINT,)}, Scene.end, ENDING),
        (RUNNING, {"respawns": 1}, Scene.end, ENDED),
        (ENDING, {"ignores": (signal.SIGINT,), "respawns": 1}, Scene.end, ENDING),
        (ENDING, {"ignores": (signal.SIGINT,), "respawns": 1}, Scene.exit, ENDED),
        (WAITING, {"respawns": 1}, Scene.wait, RUNNING),
        (WAITING, {"respawns": 1}, Scene.end, ENDED),
        (ENDED, {}, Scene.end, ENDED),
    ],
)
def test_what_happens_to_it(
    state: ProcessState, makes: dict[str, Any], happens: Any, following: ProcessState
) -> None:
    async def tell() -> None:
        scene = await Scene(**makes).come_to(state)
        if happens is not None:
            await happens(scene)
        else:
            await asyncio.sleep(1)
        assert scene.run.state is following
        assert scene.run.completed.done() is (following is ENDED)

    play(tell)


def test_its_events_and_its_return_code() -> None:
    async def tell() -> None:
        scene = await Scene().come_to(RUNNING)
        assert scene.run.return_code is None
        assert scene.events() == ["ProcessStarted"]
        scene.processes[0].exit(3)
        await scene.run.completed
        assert scene.events() == ["ProcessExited"]
        assert scene.run.return_code == 3
        assert scene.processes[0].is_closed

    play(tell)


def test_a_chunk_of_output_is_read_when_the_events_before_it_were_handled() -> None:
    """The launch handles earlier events first. So a program that writes without end can't fill the launch's
    memory.
    """

    async def tell() -> None:
        scene = await Scene().come_to(RUNNING)
        scene.events()
        for chunk in (b"one", b"two"):
            scene.processes[0].write(chunk)
        await asyncio.sleep(1)
        assert scene.events() == ["ProcessStdout"]
        await asyncio.sleep(1)
        assert scene.events() == ["ProcessStdout"]

    play(tell)


def test_what_others_have_written_after_its_end_is_read_for_half_a_second() -> None:
    async def tell() -> None:
        scene = await Scene().come_to(RUNNING)
        scene.processes[0]._ended.set_result(0)  # one of its own children holds its pipes open
        await asyncio.sleep(0.4)
        assert scene.run.state is RUNNING
        scene.events()
        scene.processes[0].write(b"late")
        await asyncio.sleep(0.05)
        assert scene.events() == ["ProcessStdout"]
        await asyncio.sleep(0.1)
        assert scene.run.state is ENDED

    play(tell)


def test_signals_escalate(capsys: pytest.CaptureFixture[str]) -> None:
    async def tell() -> None:
        scene = await Scene(ignores=(signal.SIGINT, signal.SIGTERM)).come_to(RUNNING)
        scene.run.end(says_so=True)
        sent = scene.processes[0].signals
        await asyncio.sleep(4.9)
        assert sent == [signal.SIGINT]
        await asyncio.sleep(0.2)
        assert sent == [signal.SIGINT, signal.SIGTERM]
        await asyncio.sleep(6.8)
        assert sent == [signal.SIGINT, signal.SIGTERM]
        await asyncio.sleep(0.2)
        assert sent == [signal.SIGINT, signal.SIGTERM, signal.SIGKILL]
        assert scene.run.return_code == -signal.SIGKILL

    play(tell)
    lines = [line for line in capsys.readouterr().out.splitlines() if "signal" in line or "SIG" in line]
    assert lines == [
        f"[INFO] [{NAME}]: sending signal 'SIGINT' to process[{NAME}]",
        f"[ERROR] [{NAME}]: process[{NAME}] failed to terminate '5' seconds after receiving 'SIGINT', "
        "escalating to 'SIGTERM'",
        f"[INFO] [{NAME}]: sending signal 'SIGTERM' to process[{NAME}]",
        f"[ERROR] [{NAME}]: process[{NAME}] failed to terminate '12' seconds after receiving 'SIGTERM', "
        "escalating to 'SIGKILL'",
        f"[INFO] [{NAME}]: sending signal 'SIGKILL' to process[{NAME}]",
    ]


def test_the_first_request_to_end_sends_the_only_interrupt() -> None:
    async def tell() -> None:
        scene = await Scene(ignores=(signal.SIGINT,)).come_to(RUNNING)
        for _ in range(3):
            scene.run.end(says_so=True)
            await asyncio.sleep(1)
        assert scene.processes[0].signals == [signal.SIGINT]
        await asyncio.sleep(3)
        assert scene.processes[0].signals == [signal.SIGINT, signal.SIGTERM]

    play(tell)


def test_a_process_that_ended_meanwhile_gets_no_further_signal() -> None:
    async def tell() -> None:
        scene = await Scene().come_to(RUNNING)
        scene.run.end(says_so=True)
        await asyncio.sleep(100)
        assert scene.processes[0].signals == [signal.SIGINT]

    play(tell)


def test_signals_change_no_state() -> None:
    async def tell() -> None:
        scene = await Scene(ignores=(signal.SIGUSR1,)).come_to(STARTING)
        scene.run.send(signal.SIGUSR1)  # nothing runs yet
        await scene.come_to(RUNNING)
        scene.run.send(signal.SIGUSR1)
        assert scene.run.state is RUNNING
        assert scene.processes[0].signals == [signal.SIGUSR1]
        scene.processes[0].exit(0)
        scene.run.send(signal.SIGUSR1)  # the run has not noticed the end yet
        await scene.run.completed
        scene.run.send(signal.SIGUSR1)
        assert scene.processes[0].signals == [signal.SIGUSR1]

    play(tell)


def test_it_is_started_again_as_often_as_it_may_be_after_the_delay() -> None:
    async def tell() -> None:
        scene = await Scene(respawns=2, fails=1).come_to(STARTING)
        begin = asyncio.get_running_loop().time()
        await asyncio.sleep(9)  # the first start has failed
        assert not scene.processes
        await asyncio.sleep(2)
        assert len(scene.processes) == 1
        await scene.exit()
        await asyncio.sleep(11)
        assert [one.pid for one in scene.processes] == [100, 101]
        assert scene.run.return_code is None
        await scene.exit()
        await scene.run.completed
        assert [round(one.started_s - begin) for one in scene.processes] == [10, 21]

    play(tell)


def test_after_a_start_that_failed_the_delay_is_a_second_at_least() -> None:
    async def tell() -> None:
        scene = await Scene(respawns=-1, respawn_delay_s=0.0, fails=3).come_to(STARTING)
        begin = asyncio.get_running_loop().time()
        await asyncio.sleep(2.5)
        assert not scene.fails
        assert not scene.processes
        await asyncio.sleep(1)
        await scene.exit()
        assert [round(one.started_s - begin, 1) for one in scene.processes] == [3.0, 3.5]
        await scene.end()

    play(tell)


def test_below_zero_it_is_started_again_for_ever() -> None:
    async def tell() -> None:
        scene = await Scene(respawns=-1).come_to(RUNNING)
        for _ in range(50):
            await scene.exit()
            await scene.wait()
        assert len(scene.processes) == 51
        await scene.end()
        assert scene.run.state is ENDED

    play(tell)


def test_an_end_at_the_moment_at_which_the_delay_is_over() -> None:
    async def tell() -> None:
        scene = await Scene(respawns=1, respawn_delay_s=0.0).come_to(RUNNING)
        scene.processes[0].exit(0)
        while scene.run.state is not WAITING:  # noqa: ASYNC110 (it is no event)
            await asyncio.sleep(0)
        await asyncio.sleep(0)  # the time-out has cancelled the wait, and the run does not know it yet
        scene.run.end(says_so=True)
        await scene.run.completed
        assert (scene.run.state, len(scene.processes)) == (ENDED, 1)

    play(tell)


def test_an_error_of_its_start_is_that_of_its_future() -> None:
    async def tell() -> None:
        scene = Scene(fails=1, error=KeyError("cmd"))
        with pytest.raises(KeyError):
            await scene.run.completed

    play(tell)
