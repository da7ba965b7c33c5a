"""`bus run`: scripts and modules run as Python itself would run them. No test here needs a daemon."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from bus_cli.run import Call, read

WAIT_S = 60.0 * float(os.environ.get("BUSD_TESTS_TIMEOUT_FACTOR", "1"))
PYTHON = (sys.executable,)
BUS = (sys.executable, "-m", "bus_cli")

LOOK = """
import atexit, sys
atexit.register(print, "at exit")
print(__name__, __file__, __package__, __spec__ and __spec__.name, sys.argv, sys.path[0])
print(sys.modules["__main__"].__dict__ is globals())
"""
BAD = """
def fail():
    raise ValueError("no good")

fail()
"""
ENDS = {
    "nothing": "pass",
    "a code": "import sys; sys.exit(3)",
    "a text": "import sys; sys.exit('that was it')",
    "an error": BAD,
    "a syntax error": "x = = 2\n",
    "an indentation error": "def f():\npass\n",
    "an error below": "import bad",
    "a syntax error below": "import broken",
    "a missing module": "import nosuchmodule",
    "a chain": "try:\n    import bad\nexcept ValueError as error:\n    raise KeyError('x') from error\n",
    "a context": "try:\n    1 / 0\nfinally:\n    [][1]\n",
    "a group": "raise ExceptionGroup('both', [ValueError(1), KeyError(2)])",
    "a hook": "import sys\nsys.excepthook = lambda *error: print(error[0], error[2].tb_lineno)\n1 / 0\n",
    "an exit in a thread": "import threading\nthreading.Thread(target=print, args=('later',)).start()",
    "a pickle": "import pickle\nclass A: pass\nprint(type(pickle.loads(pickle.dumps(A()))) is A)",
    "its source": "import inspect\ndef f(): return 1\nprint(inspect.getsource(f))",
    "latin-1": "# coding: latin-1\nprint('\xe9')",
}


class Result(NamedTuple):
    out: str
    err: str
    code: int


Run = Callable[..., Result]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("AMENT_PREFIX_PATH", "BUS_RCLPY_FORCE", "BUSD_SOCKET", "BUSD_DOMAIN"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


@pytest.fixture
def run(here: Path) -> Run:
    """Runs a command in the folder of the test."""

    def run(*command: str) -> Result:
        done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
        return Result(done.stdout, done.stderr, done.returncode)

    return run


@pytest.mark.parametrize("what", ENDS)
def test_a_script_ends_as_with_python(here: Path, run: Run, what: str) -> None:
    (here / "bad.py").write_text(BAD)
    (here / "broken.py").write_text(ENDS["a syntax error"])
    (here / "script.py").write_text(ENDS[what], encoding="latin-1")
    assert run(*BUS, "run", "script.py") == run(*PYTHON, "script.py")


@pytest.mark.parametrize(
    "words", [("look.py",), ("./look.py", "a", "--b"), ("sub/look.py", "--ros-args", "-h")]
)
def test_a_script_sees_what_python_shows_it(here: Path, run: Run, words: tuple[str, ...]) -> None:
    (here / "sub").mkdir()
    for path in (here, here / "sub"):
        (path / "look.py").write_text(LOOK)
    shown = run(*BUS, "run", *words)
    assert shown == run(*PYTHON, *words)
    assert shown.out.endswith("True\nat exit\n")


def test_a_link_leads_to_the_folder_of_its_target(here: Path, run: Run) -> None:
    (here / "sub").mkdir()
    (here / "sub" / "look.py").write_text(LOOK)
    (here / "link.py").symlink_to("sub/look.py")
    assert run(*BUS, "run", "link.py") == run(*PYTHON, "link.py")


@pytest.mark.parametrize(
    "words", [("look", "a", "-m"), ("pack", "--x"), ("pack.look",), ("bad",), ("nosuch",)]
)
def test_a_module(here: Path, run: Run, words: tuple[str, ...]) -> None:
    (here / "look.py").write_text(LOOK)
    (here / "bad.py").write_text(BAD)
    (here / "pack").mkdir()
    (here / "pack" / "look.py").write_text(LOOK)
    (here / "pack" / "__init__.py").write_text("")
    (here / "pack" / "__main__.py").write_text(LOOK)
    assert run(*BUS, "run", "-m", *words) == run(*PYTHON, "-m", *words)


def test_a_folder_with_a_main(here: Path, run: Run) -> None:
    (here / "pack").mkdir()
    (here / "pack" / "__main__.py").write_text("import look\nprint(__name__)")
    (here / "pack" / "look.py").write_text("print(__name__)")
    assert run(*BUS, "run", "./pack") == run(*PYTHON, "./pack")


def test_standard_input_is_the_programs(here: Path) -> None:
    (here / "echo.py").write_text("print(input())")
    done = subprocess.run(
        [*BUS, "run", "echo.py"],
        input="hello\n",
        stdout=subprocess.PIPE,
        text=True,
        timeout=WAIT_S,
        check=True,
    )
    assert done.stdout == "hello\n"


class Started:
    """A program that has printed `up`."""

    def __init__(self, *command: str) -> None:
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.first = self.process.stdout.readline()

    def end(self, number: int) -> Result:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=WAIT_S)
        return Result(out, err, self.process.returncode)


@pytest.fixture
def start(here: Path) -> Iterator[Callable[..., Started]]:
    started: list[Started] = []

    def start(*command: str) -> Started:
        started.append(Started(*command))
        assert started[-1].first == "up\n"
        return started[-1]

    yield start
    for one in started:
        one.process.kill()
        one.process.communicate()


SLEEPS = "import atexit, time\natexit.register(print, 'at exit')\nprint('up', flush=True)\ntime.sleep(1000)\n"


def test_ctrl_c_that_nobody_catches_prints_no_traceback(here: Path, start: Callable[..., Started]) -> None:
    (here / "sleeps.py").write_text(SLEEPS)
    assert start(*BUS, "run", "sleeps.py").end(signal.SIGINT) == ("at exit\n", "", -signal.SIGINT)


def test_ctrl_c_that_is_caught_is_the_programs(here: Path, start: Callable[..., Started]) -> None:
    (here / "sleeps.py").write_text(
        "import time\ntry:\n    print('up', flush=True)\n    time.sleep(1000)\n"
        "except KeyboardInterrupt:\n    print('bye')\n"
    )
    assert start(*BUS, "run", "sleeps.py").end(signal.SIGINT) == ("bye\n", "", 0)


def test_sigterm_ends_it_as_it_ends_python(here: Path, start: Callable[..., Started]) -> None:
    (here / "sleeps.py").write_text(SLEEPS)
    assert start(*BUS, "run", "sleeps.py").end(signal.SIGTERM) == ("", "", -signal.SIGTERM)


def test_where_no_daemon_is_one_line_says_so(here: Path, run: Run) -> None:
    (here / "ends.py").write_text("import bus\nraise bus.BrokerUnavailable('no busd listens')")
    assert run(*BUS, "run", "ends.py") == ("", "BrokerUnavailable: no busd listens\n", 1)


@pytest.mark.parametrize(("option", "variable"), [("-P", ""), ("", "1")])
def test_a_safe_path(
    here: Path, run: Run, option: str, variable: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only if the user asks for it: the first line of an installed `bus` may have -P."""
    monkeypatch.setenv("PYTHONSAFEPATH", variable)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path[1:]))
    (here / "near.py").write_text("")
    (here / "show.py").write_text("import near")
    command = (sys.executable, *([option] if option else []), "-m", "bus_cli")
    assert run(*command, "run", "show.py").code == (1 if variable else 0)


@pytest.mark.parametrize(
    ("words", "text", "code"),
    [
        (("talkr.py",), "bus run: 'talkr.py' does not exist\ndid you mean 'talker.py'?\n", 1),
        (
            ("sub/lisener.py",),
            "bus run: 'sub/lisener.py' does not exist\ndid you mean 'sub/listener.py'?\n",
            1,
        ),
        (("xyz.py",), "bus run: 'xyz.py' does not exist\n", 1),
        (("no/where.py",), "bus run: 'no/where.py' does not exist\n", 1),
        (("talker",), "Package 'talker' not found\ndid you mean 'talker.py'?\n", 1),
        (("--domain", "70000", "talker.py"), "domain must be an integer from 0 to 65535, not 70000\n", 1),
        (("--prefix", "'", "talker.py"), 'bus run: --prefix "\'": No closing quotation\n', 1),
        (
            ("--prefix", "nosuchcommand", "talker.py"),
            "bus run: can't run 'nosuchcommand': No such file or dir",
            1,
        ),
    ],
)
def test_what_can_not_be_run(here: Path, run: Run, words: tuple[str, ...], text: str, code: int) -> None:
    (here / "sub").mkdir()
    for name in ("talker.py", "sub/listener.py"):
        (here / name).write_text("")
    found = run(*BUS, "run", *words)
    assert (found.out, found.code) == ("", code)
    assert found.err.startswith(text)


@pytest.mark.parametrize(
    "words", [(), ("-m",), ("--nosuch", "x.py"), ("--domain", "x", "x.py"), ("--prefix",)]
)
def test_wrong_usage(run: Run, words: tuple[str, ...]) -> None:
    found = run(*BUS, "run", *words)
    assert (found.out, found.code) == ("", 2)
    assert found.err.startswith("usage: bus ")
    assert "error: " in found.err


def test_a_file_that_can_not_be_read(here: Path, run: Run) -> None:
    (here / "loop.py").symlink_to("loop2.py")
    (here / "loop2.py").symlink_to("loop.py")
    found = run(*BUS, "run", "loop.py")
    assert (found.out, found.code) == ("", 1)
    assert found.err.startswith("bus run: 'loop.py' does not exist\n")


def test_the_bus_that_was_chosen_is_the_programs(
    here: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "show.py").write_text(
        "import os; print(os.environ.get('BUSD_SOCKET'), os.environ.get('BUSD_DOMAIN'))"
    )
    assert run(*BUS, "run", "--domain", "7", "show.py").out == "None 7\n"
    assert run(*BUS, "--socket", "x.sock", "run", "show.py").out == f"{here}/x.sock None\n"
    monkeypatch.setenv("BUSD_SOCKET", "/other.sock")
    assert run(*BUS, "run", "show.py").out == "/other.sock None\n"
    assert run(*BUS, "run", "--domain=7", "show.py").out == "None 7\n"


def test_a_command_in_front(here: Path, run: Run) -> None:
    (here / "show.py").write_text("import os, sys; print(os.environ.get('COLOUR'), sys.argv); sys.exit(5)")
    shown = run(*BUS, "run", "--prefix", "env COLOUR='light blue'", "show.py", "--prefix", "a")
    assert shown == ("light blue ['show.py', '--prefix', 'a']\n", "", 5)
    shown = run(*BUS, "run", "--prefix", "env COLOUR=red", "-m", "show", "a")
    assert (shown.out.startswith("red ["), shown.code) == (True, 5)


def test_a_signal_reaches_the_child_behind_a_command(here: Path, start: Callable[..., Started]) -> None:
    (here / "sleeps.py").write_text(SLEEPS)
    assert start(*BUS, "run", "--prefix", "env", "sleeps.py").end(signal.SIGINT) == (
        "at exit\n",
        "",
        -signal.SIGINT,
    )


def test_force_is_for_the_programs_that_it_starts_too(here: Path, run: Run) -> None:
    (here / "show.py").write_text("import os; print(os.environ.get('BUS_RCLPY_FORCE'))")
    assert run(*BUS, "run", "show.py").out == "None\n"
    assert run(*BUS, "run", "--force", "show.py").out == "1\n"


def test_it_imports_little(here: Path, run: Run) -> None:
    """Modules that a script does not need do not slow its start."""
    (here / "show.py").write_text("import sys; print(*sys.modules)")
    loaded = set(run(*BUS, "run", "show.py").out.split())
    assert not loaded & {
        "argparse",
        "asyncio",
        "msgspec",
        "uvloop",
        "yaml",
        "importlib.metadata",
        "subprocess",
    }


@pytest.mark.parametrize(
    ("line", "call"),
    [
        ("run x.py", Call(["x.py"])),
        ("run --force x.py --force -m", Call(["x.py", "--force", "-m"], force=True)),
        ("run -m mod -x run", Call(["-x", "run"], module="mod")),
        ("--domain 3 run pkg exe --domain 4", Call(["pkg", "exe", "--domain", "4"], domain=3)),
        ("run --prefix=gdb --socket s x.py", Call(["x.py"], prefix="gdb", socket="s")),
        ("--json run -s --no-daemon --spin-time 1 x.py", Call(["x.py"])),
        ("run -- x.py --", Call(["x.py", "--"])),
        ("run", None),
        ("run -h", None),
        ("run --bogus x.py", None),
        ("--force run x.py", None),
        ("topic list", None),
        ("--domain 3 topic echo run", None),
        ("--version", None),
        ("", None),
    ],
)
def test_the_words_of_a_line(line: str, call: Call | None) -> None:
    assert read(line.split()) == call
