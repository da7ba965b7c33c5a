"""Parsers, dispatch and exit codes of `bus`, without a daemon."""

import signal
import sys
from argparse import _SubParsersAction
from importlib import import_module
from pathlib import Path

import pytest

import bus
from bus.process.termination import Terminated
from bus_cli import main as cli
from bus_cli import suggestions
from bus_cli.main import COMMANDS, VERBS_WITH_VERBS, make_parser, module_of, own_words, run
from bus_cli.output import CommandError
from bus_cli.query import full_topic_name, full_type_name
from rows import for_each

VERBS = [(command, verb) for command, (_, verbs) in COMMANDS.items() for verb in verbs or ("",)]
ECHOES = "'bus topic echo' or 'bus service echo' or 'bus tf2 echo'"


@pytest.fixture(autouse=True)
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No daemon exists, and the tests must not start one."""
    monkeypatch.setenv("BUSD_SOCKET", str(tmp_path / "no.sock"))
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    monkeypatch.setenv("COLUMNS", "100")
    cli._help_width.cache_clear()


def stop(*words: str) -> int:
    """The exit code of a command line at which argparse ends the program."""
    with pytest.raises(SystemExit) as caught:
        run(words)
    assert isinstance(caught.value.code, int)
    return caught.value.code


@for_each(("command", "verb"), VERBS)
def test_every_verb_has_its_module_help_and_the_common_options(
    command: str, verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(import_module(module_of(command, verb)).main)
    words = list(filter(None, (command, verb)))
    assert stop(*words, "--help") == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: {' '.join(['bus', *words])} ")
    for option in ("--socket", "--domain", "--json"):
        assert option in text


def test_help_lists_commands_and_verbs_with_their_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert stop("--help") == 0
    text = capsys.readouterr().out
    for command, (what, verbs) in COMMANDS.items():
        assert f"    {command:<19} {what}" in text
        for verb, line in verbs.items():
            assert f"  {f'{command} {verb}':<22} {line}\n" in text


@for_each("command", [one for one, (_, verbs) in COMMANDS.items() if verbs and one not in VERBS_WITH_VERBS])
def test_a_command_by_itself_prints_its_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([command]) == 0
    text = capsys.readouterr().out
    for verb, line in COMMANDS[command][1].items():
        assert f"    {verb:<19} {line}" in text


def test_an_option_of_ros2_before_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--use-python-default-buffering", "interface", "packages"]) == 0
    assert "std_msgs\n" in capsys.readouterr().out


def test_no_command_prints_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([]) == 0
    assert capsys.readouterr().out.startswith("usage: bus [-h]")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"bus {bus.__version__}\n"


@pytest.mark.parametrize(
    "words",
    [
        ("topic", "list", "--bogus"),
        ("topic", "info"),
        ("topic", "hz", "/x", "-w", "0"),
        ("topic", "hz", "/x", "-w", "x"),
        ("topic", "echo", "/x", "-l", "-1"),
        ("topic", "echo", "/x", "--timeout", "0"),
        ("topic", "pub", "/x", "std_msgs/msg/String", "-r", "0"),
        ("topic", "pub", "/x", "std_msgs/msg/String", "-1", "-t", "2"),
        ("topic", "list", "--domain", "x"),
        ("completion", "csh"),
    ],
)
def test_wrong_usage_is_two(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert stop(*words) == 2
    assert "error: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("tpoic list", "bus: there is no command 'tpoic'; did you mean 'bus topic'?"),
        ("--domain 3 topics list", "bus: there is no command 'topics'; did you mean 'bus topic'?"),
        ("echo /x", f"bus: there is no command 'echo'; did you mean {ECHOES}?"),
        ("wft", "bus: there is no command 'wft'; did you mean 'bus wtf'?"),
        ("xyz", "bus: there is no command 'xyz'; bus --help lists what there is"),
        ("topic lsit", "bus topic: there is no verb 'lsit'; did you mean 'bus topic list'?"),
        ("node xyz", "bus node: there is no verb 'xyz'; there are info, list"),
        ("trace", "bus trace: not available"),
    ],
)
def test_a_command_that_does_not_exist(line: str, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert stop(*line.split()) == 2
    assert capsys.readouterr() == ("", f"{text}\n")


def test_an_option_that_does_not_exist(capsys: pytest.CaptureFixture[str]) -> None:
    assert stop("topic", "echo", "/x", "--onec", "--raw") == 2
    assert capsys.readouterr().err.endswith("unrecognized arguments: --onec; did you mean '--once'?\n")
    assert stop("topic", "list", "--once") == 2
    assert capsys.readouterr().err.endswith("unrecognized arguments: --once\n")


@pytest.mark.parametrize("line", ["topic list", "doctor hello", "doctor", "daemon", "ros2 install"])
def test_the_usage_of_the_verb_with_an_option_that_does_not_exist(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert stop(*line.split(), "--frobnicate") == 2
    err = capsys.readouterr().err
    assert err.startswith(f"usage: bus {line} [-h]")
    assert err.endswith(f"\nbus {line}: error: unrecognized arguments: --frobnicate\n")


def test_what_is_not_there_yet_is_not_there() -> None:
    assert not {*suggestions._NOT_YET, *suggestions._OTHER_NAMES} & {*COMMANDS}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("topic", "list"), "no busd listens on"),
        (("topic", "info", "1x"), "Invalid topic name"),
        (("topic", "info", "/a//b"), "Invalid topic name"),
        (("topic", "find", "String"), "The passed message type is invalid"),
        (("node", "list", "--socket", "/x" * 80), "the path of busd's socket has"),
        (("topic", "pub", "/x", "std_msgs/msg/String", "{"), "The passed value needs to be a dictionary"),
        (("topic", "echo", "/x", "--filter", "m."), "--filter: invalid syntax"),
        (("topic", "hz", "/x", "--filter", "os"), "--filter: not allowed: os"),
    ],
)
def test_errors_are_one_with_a_text_on_stderr(
    words: tuple[str, ...], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(words) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert text in captured.err
    assert "Traceback" not in captured.err


def test_a_domain_out_of_range(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv("BUSD_SOCKET")
    assert run(["topic", "list", "--domain", "70000"]) == 1
    assert capsys.readouterr().err == "domain must be an integer from 0 to 65535, not 70000\n"


def test_only_the_chosen_verb_is_imported() -> None:
    for name in [name for name in sys.modules if name.startswith("bus_cli.topic.")]:
        del sys.modules[name]
    make_parser(["topic", "list"])
    assert [name for name in sys.modules if name.startswith("bus_cli.topic.")] == ["bus_cli.topic.list"]


def test_global_options_may_stand_anywhere() -> None:
    for words in (
        ["--socket", "/s", "--json", "topic", "list"],
        ["topic", "--socket", "/s", "--json", "list"],
        ["topic", "list", "--socket", "/s", "--json"],
        ["--socket", "/other", "topic", "list", "--socket", "/s", "--json"],
    ):
        args = make_parser(words).parse_args(words)
        assert (args.socket, args.json, args.domain, args.include_hidden_topics) == ("/s", True, None, False)


@for_each(
    "line",
    [
        "topic pub --once /t std_msgs/String hi",
        "topic pub /t --once std_msgs/String hi",
        "topic pub /t std_msgs/String --once hi",
        "topic pub /t std_msgs/String hi --once",
    ],
)
def test_options_may_stand_between_arguments(line: str) -> None:
    args = make_parser(line.split()).parse_args(line.split())
    assert (args.topic_name, args.message_type, args.values, args.once) == (
        "/t",
        "std_msgs/String",
        "hi",
        True,
    )


def test_ros2_options_that_mean_nothing_here_are_taken() -> None:
    words = ["topic", "list", "--no-daemon", "--spin-time", "2", "-s", "--include-hidden-topics"]
    assert make_parser(words).parse_args(words).include_hidden_topics


def test_a_socket_may_be_called_like_a_command() -> None:
    words = ["--socket", "node", "topic", "list", "-c"]
    args = make_parser(words).parse_args(words)
    assert (args.socket, args.count_topics) == ("node", True)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (BrokenPipeError(), 0),
        (KeyboardInterrupt(), -signal.SIGINT),
        (Terminated(), -signal.SIGTERM),
        (CommandError("x"), 1),
        (OSError("x"), 1),
    ],
)
def test_how_a_verb_may_end(
    error: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> int:
        raise error

    monkeypatch.setattr(cli, "_run", fail)
    assert run([]) == code
    assert capsys.readouterr().err == ("x\n" if code == 1 else "")


@for_each(
    ("typed", "full"),
    [("std_msgs/String", "std_msgs/msg/String"), ("a/srv/B", "a/srv/B"), ("a/msg/B", "a/msg/B")],
)
def test_types_may_be_written_without_msg(typed: str, full: str) -> None:
    assert full_type_name(typed) == full


@for_each("typed", ["", "String", "/String", "std_msgs/", "a/b/c/d", "a//b"])
def test_what_is_no_type(typed: str) -> None:
    with pytest.raises(CommandError, match="The passed message type is invalid"):
        full_type_name(typed)


def test_topics_may_be_relative() -> None:
    assert full_topic_name("chatter") == full_topic_name("/chatter") == "/chatter"


def test_every_verb_of_a_command_is_offered() -> None:
    parser = make_parser(["topic"])
    commands = next(action for action in parser._actions if isinstance(action, _SubParsersAction))
    topic = commands.choices["topic"]
    verbs = next(action for action in topic._actions if isinstance(action, _SubParsersAction))
    assert list(verbs.choices) == list(COMMANDS["topic"][1])


@for_each(
    ("line", "own", "program"),
    [
        ("doctor", "doctor", ""),
        ("doctor hello -- x", "doctor hello -- x", ""),
        ("doctor --conformance", "doctor --conformance", ""),
        ("doctor --conformance -- ./client -- -x", "doctor --conformance", "./client -- -x"),
        ("doctor --conformance ./client --json", "doctor --conformance", "./client --json"),
        (
            "doctor --conformance --json --story hello --wait=2 ./client",
            "doctor --conformance --json --story hello --wait=2",
            "./client",
        ),
        ("doctor --json --conformance -- hello", "doctor --json --conformance", "hello"),
    ],
)
def test_the_command_line_of_a_client_under_test(line: str, own: str, program: str) -> None:
    found, started = own_words(line.split())
    assert (" ".join(found), " ".join(started)) == (own, program)
