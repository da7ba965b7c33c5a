import subprocess
import sys

import pytest

from bus.errors import BrokerUnavailable, CommandLineError, ConfigurationError, StartError
from bus.process import start_errors
from bus.process.start_errors import START_ERRORS, shown_in_one_line, text_of


@pytest.fixture(autouse=True)
def pythons_own_hook(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    monkeypatch.setattr(start_errors, "_before", sys.__excepthook__)


def _fail_with(error: Exception) -> None:
    with pytest.raises(type(error)), shown_in_one_line:
        raise error


def test_only_a_start_error_changes_the_hook() -> None:
    with shown_in_one_line:
        pass
    _fail_with(ConfigurationError("depth"))
    assert sys.excepthook is sys.__excepthook__


@pytest.mark.parametrize("kind", START_ERRORS)
def test_a_start_error_is_one_line(kind: type[Exception], capsys: pytest.CaptureFixture[str]) -> None:
    error = kind("no busd")
    _fail_with(error)
    _fail_with(error)
    sys.excepthook(kind, error, error.__traceback__)
    assert capsys.readouterr().err == f"{text_of(error)}\n" == f"{kind.__name__}: no busd\n"


def test_other_errors_go_to_the_hook_before(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = list[type[BaseException]]()
    monkeypatch.setattr(sys, "excepthook", lambda kind, error, trace: seen.append(kind))
    _fail_with(BrokerUnavailable("no busd"))
    sys.excepthook(ZeroDivisionError, ZeroDivisionError(), None)
    assert seen == [ZeroDivisionError]


def test_a_prompt_shows_a_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    error = CommandLineError("-p")
    _fail_with(error)
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    sys.excepthook(CommandLineError, error, error.__traceback__)
    assert capsys.readouterr().err.startswith("Traceback")


_NATIVE = "import asyncio, bus\nasync def main():\n async with bus.Node('n'): pass\n"
PROGRAMS = {
    "bus.run": _NATIVE + "bus.run(main())",
    "asyncio.run": _NATIVE + "asyncio.run(main())",
    "bus.connect": "import bus\nbus.connect('n')",
    "rclpy": "import bus.rclpy_compat as c\nc.install()\nimport rclpy\nrclpy.init()\nrclpy.create_node('n')",
}
ENVIRONMENTS = {
    "BrokerUnavailable: no busd listens on ": {"BUSD_SOCKET": "/nowhere/b.sock", "BUSD_AUTOSTART": "0"},
    "StartError: BUSD_DOMAIN must be an integer ": {"BUSD_DOMAIN": "abc"},
    "StartError: the path of busd's socket has 200 bytes": {"BUSD_SOCKET": "/" + "x" * 199},
}


def _run(program: str, *options: str, **environ: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, *options, "-c", program],
        env={"PATH": "/usr/bin", **environ},
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize(
    ("name", "begin"),
    [
        pytest.param(name, begin, marks=() if number == 0 or name == "bus.run" else pytest.mark.nightly)
        for number, begin in enumerate(ENVIRONMENTS)
        for name in PROGRAMS
    ],
)
def test_a_program_that_cannot_start_says_one_line(name: str, begin: str) -> None:
    ended = _run(PROGRAMS[name], **ENVIRONMENTS[begin])
    assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (1, "", 1), ended.stderr
    assert ended.stderr.startswith(begin)


def test_a_wrong_parameter_is_one_line_also_with_asyncio_run() -> None:
    program = "import sys\nsys.argv[1:] = ['--ros-args', '-p', 'x']\n" + PROGRAMS["asyncio.run"]
    ended = _run(program)
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1), ended.stderr
    assert ended.stderr.startswith("CommandLineError: ")


def test_the_development_mode_shows_the_traceback() -> None:
    ended = _run(PROGRAMS["asyncio.run"], "-X", "dev", BUSD_DOMAIN="abc")
    assert "Traceback" in ended.stderr
    assert ended.stderr.rstrip().endswith("not 'abc'")


def test_an_argument_of_the_program_keeps_its_traceback() -> None:
    ended = _run("import bus\nbus.connect('n', domain=-1)")
    assert "Traceback" in ended.stderr, "the author must find the line"
    assert issubclass(StartError, ConfigurationError)


_LIMIT = "import resource\nresource.setrlimit(resource.RLIMIT_NOFILE, ({0}, {0}))\n"
_VERB = "import sys\nsys.argv[1:] = {!r}\n{}\nmain()"
SHORT = {
    **PROGRAMS,
    "bus topic echo": _VERB.format(["topic", "echo", "/x"], "from bus_cli.main import main"),
    "bus run": _VERB.format(["run", "x.py"], "from bus_cli.entry import main"),
    "busd": _VERB.format([], "from busd.run import main as run\ndef main(): sys.exit(run())"),
}


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        pytest.param(name, limit, marks=() if row % 3 == column else pytest.mark.nightly)
        for column, limit in enumerate([6, 12, 31])
        for row, name in enumerate(SHORT)
    ],
)
def test_too_few_open_files_are_one_line(name: str, limit: int) -> None:
    ended = _run(_LIMIT.format(limit) + SHORT[name], BUSD_SOCKET="/nowhere/b.sock", BUSD_AUTOSTART="0")
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1), ended.stderr
    assert f"this process may open {limit} files" in ended.stderr


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_least_limit_reaches_the_socket(name: str) -> None:
    ended = _run(_LIMIT.format(32) + PROGRAMS[name], BUSD_SOCKET="/nowhere/b.sock", BUSD_AUTOSTART="0")
    assert ended.stderr.startswith("BrokerUnavailable: no busd listens on "), ended.stderr
