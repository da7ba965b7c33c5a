"""The commands of the README and of other pages run on a busd of the test: the output has the printed shape.

The tests do not run the lines that make this test's environment (venv, pip), nor `make test`, which would
run this test. For these they check that the named files and targets exist.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import bus
from bus.msg.sensor_msgs import Image
from bus.msg.std_msgs import String
from bus_cli.main import COMMANDS as VERBS
from conftest import WAIT_S, Daemon
from pages import BLOCK, FILE, ROOT, SCRIPT, Program, Start, blocks, check, console, shape

README = (ROOT / "README.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ROBOT_SECONDS = "1"

CONSOLE = console(README)
COMMANDS = {shown.command: shown for shown in CONSOLE}
RUN = [shown for shown in CONSOLE if shown.command.startswith("bus run ")]
BUS = [shown for shown in CONSOLE if shown.command.startswith("bus ") and shown not in RUN]
BAG = [
    shown
    for shown in console((ROOT / "docs" / "bag.md").read_text())
    if shown.command.startswith(("bus bag record", "bus bag play"))
]


@pytest.fixture
def talking(start: Start) -> dict[str, Program]:
    """The programs of the README's separate terminals."""
    busd, listener, talker = "busd", "python examples/listener.py", "python examples/talker.py"
    programs = {busd: start(busd)}
    programs[busd].read_until(shape(COMMANDS[busd].output[0]))
    for command in (listener, talker):
        programs[command] = start(command)
    for command in (listener, talker):
        check(programs[command], COMMANDS[command])
    return programs


def test_separate_terminals(talking: dict[str, Program], start: Start) -> None:
    for shown in BUS:
        program = start(shown.command)
        check(program, shown)
        if shown.is_interrupted:
            code = 0 if shown.command.startswith("bus launch") else -signal.SIGINT
            assert program.end(signal.SIGINT) == code
            assert "Traceback" not in program.text
    for command in ("python examples/talker.py", "python examples/listener.py"):
        assert COMMANDS[command].is_interrupted
        assert talking[command].end(signal.SIGINT) == -signal.SIGINT
        assert "Traceback" not in talking[command].text
    assert talking["busd"].end(signal.SIGINT) == 0


def test_a_bag(daemon: Daemon, start: Start, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    talker = "python examples/talker.py"
    check(start(talker), COMMANDS[talker])  # the page's recorder starts after its talker
    recorded, played = BAG
    program = start(recorded.command, tmp_path)
    check(program, recorded)
    assert program.end(signal.SIGINT) == 0
    assert re.search(shape(recorded.farewell[0]), program.text) and "Traceback" not in program.text
    program = start(played.command, tmp_path)
    program.read_until(shape(played.output[0]))  # it only prints keys on a terminal
    assert program.end() == 0


def test_the_command_line_is_shown_with_what_newcomers_need() -> None:
    assert [shown.command for shown in BUS] == [
        "bus topic list",
        "bus topic echo /topic",
    ]


def test_scripts_of_the_readme(daemon: Daemon, lesson: Path, start: Start) -> None:
    """Each Python block is a file of the repository; `bus run` is shown with a program of the lesson."""
    files = [path.read_text() for path in (ROOT / "examples").glob("*.py")]
    assert all(block in files for block in blocks("python", README))
    assert RUN
    for shown in RUN:
        program = start(shown.command, lesson)
        check(program, shown)
        assert shown.is_interrupted
        assert program.end(signal.SIGINT) == 0
        assert "Traceback" not in program.text


def test_the_program_of_the_package_page(daemon: Daemon, tmp_path: Path, start: Start) -> None:
    page = (ROOT / "PACKAGE.md").read_text()
    ((name, text),) = SCRIPT.findall(page)
    (shown,) = console(page)
    assert shown.command == f"python {name}"
    (tmp_path / name).write_text(text)
    check(start(shown.command, tmp_path), shown)


def test_the_script_of_the_page_about_large_messages(
    daemon: Daemon, tmp_path: Path, start: Start, route: str
) -> None:
    page = (ROOT / "docs" / "large-messages.md").read_text()
    ((name, text),) = SCRIPT.findall(page)
    (shown,) = console(page)
    assert shown.command == f"python {name}"
    (tmp_path / name).write_text(text)
    check(start(shown.command, tmp_path), shown)


def test_the_scripts_of_the_page_about_actions(daemon: Daemon, tmp_path: Path, start: Start) -> None:
    page = (ROOT / "docs" / "actions.md").read_text()
    for name, text in SCRIPT.findall(page):
        (tmp_path / name).write_text(text)
    server, *rest = console(page)
    start(server.command.removesuffix(" &"), tmp_path)
    for shown in rest:
        check(start(shown.command, tmp_path), shown)


def test_the_script_of_the_page_about_lifecycle_nodes(daemon: Daemon, tmp_path: Path, start: Start) -> None:
    page = (ROOT / "docs" / "lifecycle.md").read_text()
    ((name, text),) = SCRIPT.findall(page)
    (tmp_path / name).write_text(text)
    first, *rest = console(page)
    talker = start(first.command, tmp_path)
    check(talker, first)
    for shown in rest:
        check(start(shown.command, tmp_path), shown)
    assert talker.end(signal.SIGINT) == -signal.SIGINT


async def test_the_profiles_of_the_qos_page(daemon: Daemon) -> None:
    text = (ROOT / "docs" / "qos.md").read_text()
    snippet = next(block for language, block in BLOCK.findall(text) if language == "python")
    names: dict[str, Any] = {"bus": bus, "String": String, "Image": Image}
    async with bus.Node("tester", arguments=[]) as node:
        body = "".join(f"    {line}\n" for line in snippet.splitlines())
        exec(f"async def create(node):\n{body}", names)
        await names["create"](node)
        topics = (await node.graph()).topics()
    assert set(re.findall(r'"(\w+)", (?:bus|10|")', snippet)) == {name.strip("/") for name in topics} - {
        "rosout"
    }


LESSON = (ROOT / "docs" / "lesson.md").read_text()
STEPS = [
    part
    for part in re.split(r"^(?=## )", LESSON, flags=re.MULTILINE)
    if console(part) and ". Transforms\n" not in part  # test_lesson_tf2.py runs that
]
PROGRAMS_OF_THE_LESSON = {
    "py_pubsub talker": "publisher_member_function.py",
    "py_pubsub listener": "subscriber_member_function.py",
    "py_srvcli service": "service_member_function.py",
    "py_srvcli client": "client_member_function.py",
}
"""The names in the page's packages. Here they run without pip or colcon; other tests use those."""


@pytest.fixture
def lesson(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The lesson's workspace, with its programs."""
    workspace = tmp_path / "ros2_ws"
    (workspace / "src").mkdir(parents=True)
    for name in PROGRAMS_OF_THE_LESSON.values():
        shutil.copy(ROOT / "tests" / "lesson" / name, workspace)
    for words, name in PROGRAMS_OF_THE_LESSON.items():  # for launch files, which name packages
        package, program = words.split()
        install = workspace / "install"
        for file in (".colcon_install_layout", f"share/{package}/package.xml"):
            (install / file).parent.mkdir(parents=True, exist_ok=True)
            (install / file).touch()
        path = install / "lib" / package / program
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/usr/bin/env python3\n{(workspace / name).read_text()}")
        path.chmod(0o755)
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    return workspace


def test_the_package_of_the_lesson_page(lesson: Path, start: Start) -> None:
    """Except for its folder and maintainer."""
    (shown,) = console(STEPS[0])
    program = start(shown.command, lesson / "src")
    assert program.end() == 0
    own = ("destination directory: ", "maintainer: ")
    printed = [line for line in program.text.splitlines() if not line.startswith(own)]
    assert printed == [line for line in shown.lines if not line.startswith(own)]


def test_the_lesson_page_prints_its_first_two_programs() -> None:
    printed = dict(SCRIPT.findall(LESSON))
    for name in ("publisher_member_function.py", "subscriber_member_function.py"):
        assert printed[name] == (ROOT / "tests" / "lesson" / name).read_text()


@pytest.mark.landing
@pytest.mark.parametrize("step", STEPS[1:], ids=lambda step: step.splitlines()[0].strip("# "))
def test_the_steps_of_the_lesson_page(step: str, daemon: Daemon, lesson: Path, start: Start) -> None:
    """The programs of a step still run while later commands are typed."""
    for line in "".join(blocks("sh", step)).splitlines():
        assert start(line, lesson / "src").end() == 0
    for name, text in FILE.findall(step):
        (lesson / name).parent.mkdir(exist_ok=True)
        (lesson / name).write_text(text)
    running: list[Program] = []
    for shown in console(step):
        command = shown.command
        for name, file in PROGRAMS_OF_THE_LESSON.items():
            command = command.replace(f"bus run {name}", f"bus run {file}")
        program = start(command, lesson)
        if shown.is_interrupted and command.startswith("bus launch"):
            for line in shown.output:  # of several processes, in any order
                program.read_until(f"{shape(line)}\n")
        else:
            check(program, shown)
        if shown.is_interrupted and command.startswith(("bus run", "bus launch")) and not shown.farewell:
            running.append(program)
        elif shown.is_interrupted:
            code = 0 if command.startswith("bus launch") else -signal.SIGINT
            assert program.end(signal.SIGINT) == code
            assert all(line in program.text for line in shown.farewell)
    for program in running:
        assert program.end(signal.SIGINT) in (0, -signal.SIGINT)
        assert "Traceback" not in program.text


def make(target: str, tmp_path: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`make` with the environment of this test in place of .venv."""
    stamp = tmp_path / "installed"
    stamp.touch()
    environ = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    return subprocess.run(
        ["make", target, f"BIN={Path(sys.executable).parent}", f"STAMP={stamp}", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=3 * WAIT_S,
        env={**environ, "PYTHONASYNCIODEBUG": ""},
    )


def test_make_demo(tmp_path: Path) -> None:
    (shown,) = [one for one in CONSOLE if one.command.startswith("make demo")]
    done = make("demo", tmp_path, *shown.command.split()[2:])
    printed = (done.stdout + done.stderr).splitlines()
    for line in shown.output:  # the processes print in any order
        assert any(re.fullmatch(shape(line), one) for one in printed), (line, printed)
    assert done.returncode == 0


def test_make_robot(tmp_path: Path) -> None:
    """A machine that is too slow for the robot's rates is no failure here."""
    page = console((ROOT / "docs" / "look.md").read_text())
    (shown,) = [one for one in page if one.command.startswith("make robot")]
    done = make("robot", tmp_path, re.sub(r"\d+", ROBOT_SECONDS, shown.command.split()[2]))
    printed = done.stdout.splitlines()
    *table, praise = shown.output
    for line in table:  # losses at its end depend on the machine
        pattern = shape(line.removesuffix("-"))
        assert any(re.match(pattern, one) for one in printed), (line, printed)
    slow = r"The robot failed: /\S+ (had \S+ of \S+ Hz|lost messages)"  # its queues are short
    if done.returncode == 0:
        assert printed[-1] == praise
    else:
        assert re.search(slow, done.stdout + done.stderr), printed


def test_what_is_typed_exists(tmp_path: Path) -> None:
    typed = [line for block in blocks("sh", README) for line in block.splitlines()]
    assert "make demo" in typed
    for line in typed:
        if line.startswith("make "):
            done = make(line.split()[1], tmp_path, "--dry-run")
            assert done.returncode == 0, done.stderr
            script = re.search(r"(?<!\S)[\w./]+\.py", done.stdout)
            assert script is None or (ROOT / script[0]).exists()
        elif line.startswith("bus "):
            _, command, verb, *_ = line.split()
            assert verb in VERBS[command][1]
        elif found := re.fullmatch(r"pip install -e '\.\[(\w+)\]'", line):
            assert found[1] in PROJECT["optional-dependencies"]
        else:
            assert line in ("python3 -m venv .venv", ". .venv/bin/activate", "pip install -e .")


def test_the_programs_that_pip_installs_are_there() -> None:
    scripts = PROJECT["scripts"]
    assert set(scripts) == {"busd", "bus"}
    for place in scripts.values():  # not imported here: importing `bus` changes the handling of Ctrl-C
        module, _, function = place.partition(":")
        subprocess.run([sys.executable, "-c", f"from {module} import {function}"], check=True)
