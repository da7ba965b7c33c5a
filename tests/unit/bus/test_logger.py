"""The console log: its lines, levels, filters, colours and sinks."""

import io
import itertools
import logging
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from bus import logger
from bus.errors import ConfigurationError
from bus.logger import ConsoleHandler, Filters, LogEntry, Logger, Severity, get_logger
from bus.process.ros_args import Arguments
from rows import for_each

LINE = re.compile(r"\[(DEBUG|INFO|WARN|ERROR|FATAL)\] \[\d{10}\.\d{9}\] \[([^]]+)\]: (.*)")
_numbers = itertools.count()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def log() -> Logger:
    """A logger with its own level and sinks, which no other test uses."""
    return get_logger(f"test_{next(_numbers)}")


@pytest.fixture
def default_level() -> Iterator[None]:
    yield
    logger.set_default_level(Severity.UNSET)


def record(severity: int, text: str = "hi") -> logging.LogRecord:
    made = logging.LogRecord("talker", severity, "talker.py", 7, text, (), None, "main")
    made.created = 1635316982.5
    return made


def texts(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return [line.split(": ", 1)[1] for line in capsys.readouterr().err.splitlines()]


def test_lines_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    log = get_logger("ns.minimal_publisher")
    log.set_level("debug")
    assert log.debug("a")
    assert log.info('Publishing: "Hello World: 0"')
    assert log.warn("c")
    assert log.warning("d")
    assert log.error("e")
    assert log.fatal("f")
    assert log.critical("g")
    assert log.log("h", 30)
    out, err = capsys.readouterr()
    assert out == ""
    lines = [LINE.fullmatch(line) for line in err.splitlines()]
    assert all(line is not None and line[2] == "ns.minimal_publisher" for line in lines)
    assert " ".join(f"{line[1]}={line[3]}" for line in lines if line is not None) == (
        'DEBUG=a INFO=Publishing: "Hello World: 0" WARN=c WARN=d ERROR=e FATAL=f FATAL=g WARN=h'
    )


def test_time_has_nine_digits() -> None:
    assert ConsoleHandler({}).format(record(20)) == "[INFO] [1635316982.500000000] [talker]: hi"


def test_text_is_taken_as_it_is(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    log.info("100 % {name} %s")
    log.info(17)
    log.info("")
    assert texts(capsys) == ["100 % {name} %s", "17", ""]


def test_info_is_the_default_level(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    assert log.get_effective_level() is Severity.INFO
    assert not log.debug("hidden")
    assert not log.is_enabled_for(Severity.DEBUG)
    assert log.is_enabled_for("info")
    assert capsys.readouterr().err == ""


def test_level_reaches_children_that_have_none(log: Logger) -> None:
    child = log.get_child("a").get_child("b")
    assert child.name == f"{log.name}.a.b"
    log.set_level(Severity.ERROR)
    assert child.get_effective_level() is Severity.ERROR
    child.set_level("Debug")
    assert child.get_effective_level() is Severity.DEBUG
    child.set_level(Severity.UNSET)
    assert child.get_effective_level() is Severity.ERROR


def test_level_belongs_to_the_name(log: Logger) -> None:
    log.set_level(Severity.FATAL)
    assert get_logger(log.name).get_effective_level() is Severity.FATAL


def test_a_deprecated_remap_rule_is_warned_of_once(capsys: pytest.CaptureFixture[str]) -> None:
    rule = f"a:=test_{next(_numbers)}"
    for _ in range(2):
        logger.configure(Arguments.parse([rule]))
    assert texts(capsys) == [
        f"found remap rule '{rule}'; this syntax is deprecated, use --ros-args -r {rule}"
    ]


@pytest.mark.usefixtures("default_level")
def test_default_level(log: Logger) -> None:
    logger.set_default_level("warn")
    assert log.get_effective_level() is Severity.WARN
    logger.set_default_level("unset")
    assert log.get_effective_level() is Severity.INFO


def test_level_set_through_logging(log: Logger) -> None:
    logging.getLogger(f"bus.nodes.{log.name}").setLevel(25)
    assert log.get_effective_level() is Severity.WARN


@pytest.mark.parametrize("level", [15, "loud", "warning", -1])
def test_bad_levels(log: Logger, level: int | str) -> None:
    with pytest.raises(ConfigurationError, match=r"is no severity \(UNSET 0, DEBUG 10, INFO 20"):
        log.set_level(level)
    with pytest.raises(ConfigurationError, match="is no severity"):
        log.log("text", level)


def test_empty_names(log: Logger) -> None:
    with pytest.raises(ConfigurationError, match=r"^Logger name must not be empty\.$"):
        get_logger("")
    with pytest.raises(ConfigurationError, match=r"^Child logger name must not be empty\.$"):
        log.get_child("")


def test_once(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    results = [log.info(f"first {i}", once=True) for i in range(3)]
    assert results == [True, False, False]
    log.info("elsewhere", once=True)
    assert texts(capsys) == ["first 0", "elsewhere"]


def test_two_calls_on_one_line_are_two_places(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        log.info("a", once=True), log.info("b", once=True)
    assert texts(capsys) == ["a", "b"]


def test_filter_waits_for_the_severity(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    for level in (Severity.INFO, Severity.DEBUG, Severity.DEBUG):
        log.set_level(level)
        log.debug(level.name, once=True)
    assert texts(capsys) == ["DEBUG"]


def test_skip_first(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    for i in range(3):
        log.warning(f"{i}", skip_first=True)
    assert texts(capsys) == ["1", "2"]


def test_skip_first_and_once(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    for i in range(4):
        log.error(f"{i}", skip_first=True, once=True)
    assert texts(capsys) == ["1"]


@pytest.mark.parametrize(
    ("filters", "expected"),
    [
        ({"throttle_duration_sec": 1.0}, ["100.0", "101.0", "103.0"]),
        ({"throttle_duration_sec": 1.0, "skip_first": True}, ["101.0", "103.0"]),
        ({"throttle_duration_sec": 1.0, "skip_first": True, "once": True}, ["101.0"]),
    ],
)
def test_throttle_comes_before_the_other_filters(
    filters: Filters, expected: list[str], log: Logger, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 100.0
    monkeypatch.setattr("bus.logger.time.monotonic", lambda: now_s)
    logged = []
    for now_s in (100.0, 100.5, 101.0, 101.9, 103.0):
        if log.info("x", **filters):
            logged.append(f"{now_s}")
    assert logged == expected


def test_unknown_keyword(log: Logger) -> None:
    with pytest.raises(TypeError, match="throttle"):
        log.info("x", throttle=1)  # type: ignore[call-arg]


@for_each(
    ("template", "expected"),
    [
        ("[{severity}] [{name}]: {message}", "[WARN] [talker]: hi"),
        ("{time} {message}", "1635316982.500000000 hi"),
        ("{time_as_nanoseconds}", "1635316982500000000"),
        ("{file_name}:{line_number} {function_name}()", "talker.py:7 main()"),
        ("100% {message} %s {unknown} {{message}}", "100% hi %s {unknown} {hi}"),
        ("", "[WARN] [1635316982.500000000] [talker]: hi"),
    ],
)
def test_format_from_the_environment(template: str, expected: str) -> None:
    handler = ConsoleHandler({"RCUTILS_CONSOLE_OUTPUT_FORMAT": template})
    assert handler.format(record(30)) == expected


@pytest.mark.parametrize(
    ("severity", "colour"), [(10, "\x1b[32m"), (20, ""), (30, "\x1b[33m"), (40, "\x1b[31m"), (50, "\x1b[31m")]
)
def test_colours_on_a_terminal(severity: int, colour: str, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    ConsoleHandler({}).emit(record(severity))
    reset = "\x1b[0m" if colour else ""
    line = f"[{Severity(severity).name}] [1635316982.500000000] [talker]: hi"
    assert terminal.getvalue() == f"{colour}{line}{reset}\n"


@pytest.mark.parametrize(
    ("stream", "environ", "coloured"),
    [
        (Terminal, {}, True),
        (Terminal, {"NO_COLOR": "1"}, False),
        (Terminal, {"NO_COLOR": ""}, True),
        (Terminal, {"RCUTILS_COLORIZED_OUTPUT": "0"}, False),
        (io.StringIO, {}, False),
        (io.StringIO, {"RCUTILS_COLORIZED_OUTPUT": "1"}, True),
        (io.StringIO, {"RCUTILS_COLORIZED_OUTPUT": "1", "NO_COLOR": "1"}, False),
    ],
)
def test_when_there_is_colour(
    stream: type[io.StringIO], environ: dict[str, str], coloured: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = stream()
    monkeypatch.setattr(sys, "stderr", target)
    ConsoleHandler(environ).emit(record(40))
    assert ("\x1b" in target.getvalue()) is coloured


def test_stream_that_only_writes_and_flushes(log: Logger, monkeypatch: pytest.MonkeyPatch) -> None:
    class Tee:
        lines: list[str] = []  # noqa: RUF012

        def write(self, text: str) -> None:
            self.lines.append(text)

        def flush(self) -> None: ...

    monkeypatch.setattr(sys, "stderr", Tee())
    log.info("x")
    assert [line.endswith(": x\n") for line in Tee.lines] == [True]


def test_closed_or_missing_stderr(log: Logger, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = io.StringIO()
    closed.close()
    monkeypatch.setattr(sys, "stderr", closed)
    assert log.info("lost")
    monkeypatch.setattr(sys, "stderr", None)
    assert log.info("lost")


def test_broken_pipe_does_not_end_the_program() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [
                sys.executable,
                "-c",
                "from bus.logger import get_logger\n"
                "log = get_logger('talker')\n"
                "for i in range(3000): log.info('Hello World: %d' % i)\n"
                "print('alive')\n",
            ],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=subprocess.PIPE,
            stderr=writer,
            timeout=60,
            check=False,
        )
    finally:
        os.close(writer)
    assert done.stdout == b"alive\n"


def test_others_are_left_alone(log: Logger) -> None:
    seen: list[logging.LogRecord] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            seen.append(record)

    handler = Collector()
    root = logging.getLogger()
    before = (root.level, list(root.handlers))
    root.addHandler(handler)
    try:
        log.error("ours")
        logging.getLogger("someone.else").error("theirs")
    finally:
        root.removeHandler(handler)
    assert [one.getMessage() for one in seen] == ["theirs"]
    assert (root.level, list(root.handlers)) == before
    assert logging.getLogger("bus").handlers == []


def test_console_can_be_turned_off(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    entries: list[LogEntry] = []
    log.add_sink(entries.append)
    logger.enable_console(False)
    try:
        log.fatal("silent")
    finally:
        logger.enable_console(True)
    log.info("back")
    assert texts(capsys) == ["back"]
    assert [entry.text for entry in entries] == ["silent", "back"]


def test_sink_gets_the_whole_entry(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    entries: list[LogEntry] = []
    log.add_sink(entries.append)
    log.warning("look", once=True)
    (entry,) = entries
    assert entry == (
        30,
        entry.stamp_ns,
        log.name,
        "look",
        __file__,
        "test_sink_gets_the_whole_entry",
        entry.line,
    )
    assert type(entry.severity) is int
    assert f"[{entry.stamp_ns // 10**9}.{entry.stamp_ns % 10**9:09d}]" in capsys.readouterr().err
    with open(__file__, encoding="utf-8") as source:  # noqa: PTH123
        assert 'log.warning("look"' in source.readlines()[entry.line - 1]


def test_sink_hears_children_and_what_is_enabled_only(log: Logger) -> None:
    entries: list[LogEntry] = []
    log.add_sink(entries.append)
    log.get_child("sub").info("child")
    log.debug("hidden")
    get_logger(f"{log.name}_other").info("stranger")
    assert [(entry.name, entry.text) for entry in entries] == [(f"{log.name}.sub", "child")]


def test_removed_sink_hears_nothing(log: Logger) -> None:
    entries: list[LogEntry] = []
    log.add_sink(entries.append)
    log.remove_sink(entries.append)
    log.remove_sink(print)
    log.info("x")
    assert entries == []


def test_sink_that_logs_does_not_hear_itself(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[str] = []

    def sink(entry: LogEntry) -> None:
        heard.append(entry.text)
        log.info("from the sink")

    log.add_sink(sink)
    log.info("one")
    log.info("two")
    assert heard == ["one", "two"]
    assert sorted(texts(capsys)) == ["from the sink", "from the sink", "one", "two"]


def test_sink_that_raises_does_not_reach_the_caller(log: Logger, capsys: pytest.CaptureFixture[str]) -> None:
    def sink(entry: LogEntry) -> None:
        raise RuntimeError("no room")

    log.add_sink(sink)
    assert log.info("one")
    assert log.info("two")
    assert capsys.readouterr().err.count("RuntimeError: no room") == 2


def test_a_sink_that_waits_does_not_hold_up_other_threads(log: Logger) -> None:
    inside, release = threading.Event(), threading.Event()
    heard: list[str] = []

    def sink(entry: LogEntry) -> None:
        if entry.text == "slow":
            inside.set()
            release.wait(30)
        heard.append(entry.text)

    log.add_sink(sink)
    slow = threading.Thread(target=log.info, args=("slow",))
    slow.start()
    assert inside.wait(30)
    log.info("quick")
    release.set()
    slow.join(30)
    assert heard == ["quick", "slow"]
