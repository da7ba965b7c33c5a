"""bus_launch.launch_testing.processes: the choice of a process, its output, and its exit code."""

import re
from typing import Any

import pytest

from bus_launch.launch.actions import ExecuteProcess
from bus_launch.launch.events.process import ProcessExited, ProcessStarted, ProcessStderr, ProcessStdout
from bus_launch.launch_testing.asserts import (
    EXIT_SIGINT,
    SequentialTextChecker,
    assertDefaultStream,
    assertExitCodes,
    assertInStderr,
    assertInStdout,
    assertInStream,
    assertSequentialStdout,
)
from bus_launch.launch_testing.lookup import NO_CMD_ARGS, matching, resolveProcesses
from bus_launch.launch_testing.processes import (
    ActiveIoHandler,
    ActiveProcInfoHandler,
    NoMatchingProcessException,
)
from bus_launch.launch_testing.text import build_text_match
from rows import for_each

TALKER, LISTENER = ExecuteProcess(cmd=["talker"]), ExecuteProcess(cmd=["listener"])


def details(action: Any, name: str) -> dict[str, Any]:
    return {
        "action": action,
        "name": name,
        "cmd": [name.partition("-")[0], "--fast"],
        "cwd": None,
        "env": None,
    }


@pytest.fixture
def info() -> ActiveProcInfoHandler:
    info = ActiveProcInfoHandler()
    info.append(ProcessStarted(**details(TALKER, "talker-1")))
    info.append(ProcessExited(returncode=3, **details(LISTENER, "listener-2")))
    return info


@pytest.fixture
def output() -> ActiveIoHandler:
    output = ActiveIoHandler()
    output.append(ProcessStdout(text=b"first sec", **details(TALKER, "talker-1")))
    output.append(ProcessStderr(text=b"oops", **details(TALKER, "talker-1")))
    output.append(ProcessStdout(text=b"ond third", **details(TALKER, "talker-1")))
    output.append(ProcessStdout(text=b"heard", **details(LISTENER, "listener-2")))
    return output


def test_which_process_is_meant(info: ActiveProcInfoHandler) -> None:
    assert matching(info, TALKER) is TALKER
    assert matching(info, "listener-2") is LISTENER
    assert matching(info, "alk") is TALKER
    assert matching(info, "talker", "--fast") is TALKER
    assert set(resolveProcesses(info)) == {TALKER, LISTENER}
    assert set(resolveProcesses(info, process="e", strict_proc_matching=False)) == {TALKER, LISTENER}
    procs = "Procs: listener-2 --fast, talker-1 --fast"
    for process, words, text in (
        ("x", None, f"Did not find any processes matching name 'x' and args 'None'. {procs}"),
        ("talker", "x", f"Did not find any processes matching name 'talker' and args 'x'. {procs}"),
        (
            "talker",
            NO_CMD_ARGS,
            "Did not find any processes matching name 'talker' and args '<object",
        ),
        ("e", ["--fast"], f"Found multiple processes matching name 'e' and args '['--fast']'. {procs}"),
        (ExecuteProcess(cmd=["x"]), None, "No data recorded for proc ExecuteProcess("),
    ):
        with pytest.raises(NoMatchingProcessException) as caught:
            matching(info, process, words)
        assert str(caught.value).startswith(text)
    with pytest.raises(TypeError, match="must be 'ExecuteProcess' or 'str' not"):
        matching(info, 5)
    with pytest.raises(NoMatchingProcessException, match="No data recorded for any process"):
        resolveProcesses(ActiveIoHandler())


def test_an_exact_name_is_meant_before_a_part_of_another() -> None:
    info = ActiveProcInfoHandler()
    info.append(ProcessStarted(**details(LISTENER, "a-12")))
    info.append(ProcessStarted(**details(TALKER, "a-1")))
    assert matching(info, "a-1") is TALKER
    assert info["a-1"].action is TALKER
    with pytest.raises(KeyError, match="Did not find any processes matching name 'b'"):
        info["b"]


def test_the_output_of_one_process_or_of_all(output: ActiveIoHandler) -> None:
    assert output.text(TALKER, "stdout") == "first second third"
    assert output.text("talker", "stderr") == "oops"
    assert output.text("talker") == "first secoopsond third"
    assert output.text(stream="stdout") == "first second thirdheard"
    assert output.process_names() == ["talker-1", "listener-2"]


@for_each(
    ("expected", "is_there"),
    [
        ("two", True),
        (["one", "three"], True),
        (["three", "one"], False),
        (["one", "one"], False),
        (re.compile("t.o"), True),
        ([re.compile("t.o"), "three"], True),
        ([re.compile("three$"), re.compile("t.o")], False),
        ("four", False),
    ],
)
def test_what_a_text_contains(expected: Any, is_there: bool) -> None:
    assert (build_text_match(expected)("one two three") is not None) is is_there


def test_waiting(info: ActiveProcInfoHandler, output: ActiveIoHandler) -> None:
    info.assertWaitForStartup("talker", timeout=0)
    info.assertWaitForShutdown("listener", timeout=0)
    with pytest.raises(AssertionError, match="Timed out waiting for process 'talker' to finish"):
        info.assertWaitForShutdown("talker", timeout=0)
    with pytest.raises(AssertionError, match="Timed out waiting for process 'x' to start"):
        info.assertWaitForStartup("x", timeout=0)
    output.assertWaitFor("oops", "talker", timeout=0)
    assert not output.waitFor("first", "talker", timeout=0), "stderr is meant, if no stream is given"
    assert not output.waitFor("first", "x", stream="stdout", timeout=0)
    assert output.waitFor("OOPS", "talker", output_filter=str.upper, timeout=0)
    with pytest.raises(ValueError, match="must be 'stdout' or 'stderr'"):
        output.waitFor("first", stream="stdin", timeout=0)
    with pytest.raises(ValueError, match="output_filter is not callable"):
        assertInStderr(output, "oops", "talker", output_filter=5)


def test_assertions(info: ActiveProcInfoHandler, output: ActiveIoHandler) -> None:
    assertExitCodes(info, [0, 3], "listener")
    with pytest.raises(AssertionError, match="Proc listener-2 exited with code 3"):
        assertExitCodes(info, process="listener")
    with pytest.raises(AssertionError, match="Proc talker-1 exited with code None"):
        assertExitCodes(info, [3])
    killed = ActiveProcInfoHandler()
    killed.append(ProcessExited(returncode=-2, **details(TALKER, "talker-1")))
    assertExitCodes(killed, [EXIT_SIGINT])
    assertExitCodes(killed, [-2])
    with pytest.raises(AssertionError, match="Proc talker-1 exited with code -2"):
        assertExitCodes(killed, [2])
    with pytest.raises(AssertionError, match="Provided exit code 0 is not an int"):
        assertExitCodes(killed, ["0"])  # type: ignore[list-item]
    assertInStdout(output, "second", TALKER)
    assertInStream(output, "oops", "talker")
    assert assertDefaultStream() == "stderr"
    assertInStderr(output, "oops", TALKER)
    with pytest.raises(AssertionError, match="Did not find 'oops'"):
        assertInStdout(output, "oops", TALKER)
    with assertSequentialStdout(output, TALKER) as stdout:
        stdout.assertInStdout("first")
        stdout.assertInStdout("third")
        with pytest.raises(
            AssertionError, match=r"'second' not found in sequence after .*\nfirst second third"
        ):
            stdout.assertInStdout("second")


def test_texts_in_turn_are_found_one_after_the_other() -> None:
    text = SequentialTextChecker(["a b", " a"])
    text.assertInText("a")
    text.assertInText("a")
    with pytest.raises(AssertionError, match="'a' not found in sequence"):
        text.assertInText("a")


def test_a_process_that_has_all_arguments_is_meant() -> None:
    info = ActiveProcInfoHandler()
    for action, word in ((TALKER, "--slow"), (LISTENER, "--loud")):
        process = details(action, f"node-{word}")
        info.append(ProcessStarted(**process | {"cmd": ["node", "--fast", word]}))
    assert matching(info, "node", ["--fast", "--loud"]) is LISTENER
    assert matching(info, "node", "--slow") is TALKER
    with pytest.raises(NoMatchingProcessException, match="Did not find any"):
        matching(info, "node", ["--slow", "--loud"])
