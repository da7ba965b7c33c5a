"""A forked program is like a started one: for itself, for others, and at its end."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from forks import Fork, Forks

Run = Callable[..., Fork]


@pytest.fixture
def run(forks: Forks, tmp_path: Path) -> Run:
    """Start a program with this source. Its output goes to files named after the streams."""

    def run(source: str, *arguments: str, is_finalized: bool = True) -> Fork:
        words = [str(tmp_path / "program.py"), *arguments]
        Path(words[0]).write_text(source)
        with (tmp_path / "stdout").open("wb") as out, (tmp_path / "stderr").open("wb") as errors:
            out_number, error_number = out.fileno(), errors.fileno()
            return forks.run(words, stdout=out_number, stderr=error_number, is_finalized=is_finalized)

    return run


def test_it_sees_what_it_was_given(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FRUIT", "pear")
    monkeypatch.chdir(tmp_path)
    source = "import os, sys\nprint(__name__, sys.argv, os.environ['FRUIT'], os.getcwd(), sys.stdin.read())"
    assert run(source, "a", "b c").wait(60) == 0
    words = [str(tmp_path / "program.py"), "a", "b c"]
    assert (tmp_path / "stdout").read_text() == f"__main__ {words} pear {tmp_path} \n"


def test_it_has_the_descriptors_of_its_streams_only(run: Run, tmp_path: Path) -> None:
    assert run("import os\nprint(sorted(map(int, os.listdir('/proc/self/fd')))[:-1])").wait(60) == 0
    assert (tmp_path / "stdout").read_text() == "[0, 1, 2]\n"


def test_others_see_its_command_line_and_environment(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FRUIT", "pear")
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as started:
        program = run("import signal\nprint('ready', flush=True)\nsignal.pause()", "word")
        while not (tmp_path / "stdout").read_text():
            assert program.poll() is None
        seen = Path(f"/proc/{program.pid}/cmdline").read_bytes().split(b"\0")
        assert seen == [os.fsencode(word) for word in [*program.args, ""]]
        assert b"FRUIT=pear" in Path(f"/proc/{program.pid}/environ").read_bytes().split(b"\0")
        names = [Path(f"/proc/{pid}/comm").read_text() for pid in (program.pid, started.pid)]
        assert names[0] == names[1]
        started.communicate(b"\n")
    program.kill()
    assert program.wait(60) == -signal.SIGKILL


@pytest.mark.parametrize(
    ("source", "status", "said"),
    [
        ("import sys; sys.exit(3)", 3, ""),
        ("import sys; sys.exit('no such bus')", 1, "no such bus\n"),
        ("import atexit, os; atexit.register(os.write, 2, b'bye')", 0, "bye"),
        ("1 / 0", 1, "ZeroDivisionError: division by zero\n"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGINT)", -signal.SIGINT, "KeyboardInterrupt\n"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGTERM)", -signal.SIGTERM, ""),
    ],
    ids=["status", "words", "atexit", "exception", "interrupt", "signal"],
)
@pytest.mark.parametrize("is_finalized", [True, False])
def test_it_ends_as_programs_do(
    run: Run, tmp_path: Path, source: str, status: int, said: str, is_finalized: bool
) -> None:
    assert run(source, is_finalized=is_finalized).wait(60) == status
    text = (tmp_path / "stderr").read_text()
    assert text.endswith(said) if said else not text


@pytest.mark.parametrize("is_finalized", [True, False])
def test_at_its_end_threads_come_first_then_what_was_registered(
    run: Run, tmp_path: Path, is_finalized: bool
) -> None:
    source = (
        "import atexit, threading, time\natexit.register(print, 'registered')\n"
        "class Kept:\n    def __del__(self): print('taken apart')\n"
        "kept = Kept()\nsaid = threading.Event()\n"
        "def late():\n    said.wait()\n    time.sleep(0.05)\n    print('thread')\n"
        "threading.Thread(target=late).start()\nprint('main')\nsaid.set()"
    )
    assert run(source, is_finalized=is_finalized).wait(60) == 0
    lines = (tmp_path / "stdout").read_text().splitlines()
    assert lines == ["main", "thread", "registered", *(["taken apart"] if is_finalized else [])]


def test_one_that_runs_is_waited_for_no_longer_than_asked(run: Run) -> None:
    program = run("import signal\nsignal.pause()")
    with pytest.raises(subprocess.TimeoutExpired):
        program.wait(0.001)
    program.terminate()
    assert program.wait(60) == -signal.SIGTERM


def test_an_interpreter_that_would_start_otherwise_is_not_forked(
    forks: Forks, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONASYNCIODEBUG", "1")
    assert forks.can_run()
    monkeypatch.setenv("PYTHONPATH", "/somewhere/else")
    assert not forks.can_run()


def test_a_program_on_the_command_line(forks: Forks, tmp_path: Path) -> None:
    source = (
        "import msgspec, sys\n"
        "class One(msgspec.Struct):\n    next: 'One | None' = None\n"
        "print(__name__, sys.argv, repr(sys.path[0]), sys.modules['__main__'].One is One)\n"
        "print(msgspec.json.decode(b'{\"next\":{}}', type=One))\n"
        "sys.exit(3)"
    )
    with (tmp_path / "stdout").open("wb") as out:
        program = forks.run(["-c", source, "a", "b c"], stdout=out.fileno())
    assert program.wait(60) == 3
    said = "__main__ ['-c', 'a', 'b c'] '' True\nOne(next=One(next=None))\n"
    assert (tmp_path / "stdout").read_text() == said


def test_a_forking_process_nobody_needed_never_starts() -> None:
    with Forks() as unused:
        assert unused.can_run()
    assert unused._process is None


def test_several_threads_begin_and_end_programs(forks: Forks) -> None:
    def run(code: int) -> int:
        return forks.run(["-c", f"raise SystemExit({code})"]).wait(60)

    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(run, range(20))) == list(range(20))
