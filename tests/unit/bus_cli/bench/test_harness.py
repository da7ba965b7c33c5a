"""The processes of a measurement: the harness waits for no dead process, leaves none running, and gets their
whole output.
"""

import signal
import sys
import tempfile
from pathlib import Path

import pytest

from bus.process.termination import Terminated
from bus_cli.bench import harness
from bus_cli.bench.harness import START_S, Failure, Group
from bus_cli.bench.interrupts import deferred, end_on_signals

SLEEPER = "import time; time.sleep(600)"
UP = """print('{"event": "up"}', flush=True)"""
REFUSE, DIE = "raise SystemExit('no library')", "import os; os.kill(os.getpid(), 9)"
STUBBORN = f"import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); {UP}; {SLEEPER}"


@pytest.fixture(autouse=True)
def no_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short time limit, as some children do not end on request."""
    monkeypatch.setattr(harness, "STOP_S", 1.0)


def _is_there(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


@pytest.mark.parametrize(("ends", "what"), [(False, "say 'ready'"), (True, "end")])
def test_a_child_that_hangs_is_a_failure_and_is_killed(ends: bool, what: str) -> None:
    with pytest.raises(Failure, match=rf"rival did not {what} within 0\.1 s"), Group() as group:
        child = group.start("rival", sys.executable, "-c", SLEEPER, ends=ends)
        if ends:
            group.wait(child, within_s=0.1)
        group.expect(child, "ready", within_s=0.1)

    assert not _is_there(child.pid)
    assert not group.folder.exists()


@pytest.mark.parametrize("ends", [False, True])
@pytest.mark.parametrize(
    ("last", "how"), [(REFUSE, "exited with 1: no library"), (DIE, "was ended by SIGKILL")]
)
def test_a_child_that_dies_is_a_failure_at_once_that_says_how(ends: bool, last: str, how: str) -> None:
    with pytest.raises(Failure, match=f"rival {how}"), Group() as group:
        other = group.start("other", sys.executable, "-c", "input()")
        child = group.start("rival", sys.executable, "-c", f"{UP}; input(); {last}", ends=ends)
        group.expect(child, "up", within_s=START_S)
        child.send("go")
        # It waits for another child; the harness notices this child's end all the same.
        group.expect(other, "ready", within_s=3600)


def test_a_child_that_closed_its_output_is_given_its_time_and_no_more() -> None:
    code = f"import os; os.close(1); {SLEEPER}"
    with pytest.raises(Failure, match="did not say 'ready'"), Group() as group:
        group.expect(group.start("rival", sys.executable, "-c", code), "ready", within_s=0.5)


def test_a_server_that_ignores_its_signal_is_killed() -> None:
    with pytest.raises(RuntimeError), Group() as group:
        child = group.start("server", sys.executable, "-c", STUBBORN, stop_signal=signal.SIGTERM)
        group.expect(child, "up", within_s=START_S)
        raise RuntimeError

    assert not _is_there(child.pid)


def test_children_are_reaped_when_the_measurement_is_interrupted() -> None:
    with pytest.raises(KeyboardInterrupt), Group() as group:
        children = [group.start(f"child_{index}", sys.executable, "-c", SLEEPER) for index in range(3)]
        raise KeyboardInterrupt

    assert not any(_is_there(child.pid) for child in children)


def test_what_a_child_prints_for_people_is_passed_over_and_broken_events_are_not() -> None:
    with Group() as group:
        lines = 'hello\\n{"event": "first", "n": 1}\\n{"event": "second"}'
        child = group.start("talkative", sys.executable, "-c", f"print('''{lines}'''); input()")
        group.expect(child, "second", within_s=START_S)
        assert child.take("first") == {"event": "first", "n": 1}
        assert child.cpu_ns() > 0
        broken = group.start("broken", sys.executable, "-c", "print('{nonsense'); input()")
        with pytest.raises(Failure, match="broken printed a line that is not JSON"):
            group.expect(broken, "ready", within_s=START_S)
        child.send("enough")
        broken.send("enough")


def test_a_long_line_comes_whole_and_what_is_behind_it_as_well() -> None:
    lines = """'{"event": "long", "text": "%s"}' % ("x" * 3_000_000), '{"event": "short"}'"""
    code = f"print({lines}, sep='\\n'); input()"
    with Group() as group:
        child = group.start("talkative", sys.executable, "-uc", code)
        long = group.expect(child, "long", within_s=START_S)
        assert group.expect(child, "short", within_s=START_S) == {"event": "short"}
    assert long["text"] == "x" * 3_000_000
    with pytest.raises(Failure, match="the event 'long' came without 'number'"):
        long["number"]


def test_what_is_published_of_an_end_has_no_path_of_this_machine(tmp_path: Path) -> None:
    code = "import os; raise SystemExit(f'no {os.getcwd()}/library')"
    with pytest.raises(Failure, match=r"^rival exited with 1: no \./library$"), Group(tmp_path) as group:
        group.expect(group.start("rival", sys.executable, "-c", code), "ready", within_s=START_S)


def test_sockets_have_room_where_the_folder_for_temporary_files_is_deep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = tmp_path / ("d" * 100)
    deep.mkdir()
    for folder, used in ((deep, Path("/tmp")), (Path("/tmp"), Path("/tmp"))):
        monkeypatch.setattr(tempfile, "tempdir", str(folder))
        with Group() as group:
            assert group.folder.parent == used


# --- interrupts


@pytest.mark.parametrize(
    ("number", "kind"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)]
)
def test_an_interrupt_comes_when_what_must_be_whole_is_done(
    number: signal.Signals, kind: type[KeyboardInterrupt]
) -> None:
    done: list[str] = []
    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        end_on_signals()
        with pytest.raises(kind), deferred():
            signal.raise_signal(number)
            done.append("all")
        with deferred():
            pass
        with pytest.raises(kind):
            signal.raise_signal(number)
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    assert done == ["all"]
