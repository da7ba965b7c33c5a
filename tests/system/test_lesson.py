"""The ROS 2 beginner lesson: its programs (tests/lesson), started by the lesson's commands."""

import asyncio
import importlib.util
import os
import re
import signal
import subprocess
import sys
import venv
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import String
from conftest import Daemon
from packaged import VERSION, WAIT_S, run_bus, sources
from programs import EXAMPLES, Program, assert_nothing_is_left, on_one_loop, running
from semantics import until

LESSON = Path(__file__).parents[1] / "lesson"
RUN = ("-m", "bus_cli", "run")
FROM_INSIDE = (
    "-c",
    "import bus.rclpy_compat, runpy, sys; del sys.argv[0]; runpy.run_path(sys.argv[0], run_name='__main__')",
)
STAMP = r"\[INFO\] \[\d{10}\.\d{9}\]"
PUBLISHED = re.compile(STAMP + r' \[minimal_publisher\]: Publishing: "Hello World: (\d+)"')
NAMESAKE = "[bus]: there is another node named "
HEARD = re.compile(STAMP + r' \[minimal_subscriber\]: I heard: "Hello World: (\d+)"')


def numbers(program: Program, pattern: re.Pattern[str]) -> list[int]:
    """The numbers in its lines. Every line must fit, except the warning about two nodes with one name."""
    found = [pattern.fullmatch(line) for line in program.lines if NAMESAKE not in line]
    assert all(found), program.lines
    return [int(one[1]) for one in found if one]


async def interrupt(program: Program, number: int = signal.SIGINT) -> int:
    program.process.send_signal(number)
    return await program.end()


async def said_too(talker: Program, *listeners: Program) -> None:
    """Wait until the talker has printed all received messages: it publishes before it prints."""
    for listener in listeners:
        await talker.line(f'"Hello World: {numbers(listener, HEARD)[-1]}"$')


def assert_consecutive(heard: list[int], published: list[int]) -> None:
    assert heard == list(range(heard[0], heard[0] + len(heard)))
    assert published == list(range(len(published)))
    assert heard[-1] in published


async def subscribed(topic: str) -> None:
    """Wait until a subscription exists and would receive the first message."""
    async with bus.Node("look", arguments=()) as node:
        publisher = await node.create_publisher(String, topic)
        await publisher.wait_for_subscriptions()


# --- publisher and subscriber


@pytest.mark.usefixtures("daemon", "route")
@pytest.mark.parametrize(
    ("way", "form", "code"),
    [
        pytest.param(RUN, "node", -signal.SIGINT, id="run, older"),
        pytest.param(RUN, "member_function", 0, id="run, newer", marks=pytest.mark.nightly),
        pytest.param(FROM_INSIDE, "node", -signal.SIGINT, id="import, older", marks=pytest.mark.nightly),
        pytest.param(FROM_INSIDE, "member_function", 0, id="import, newer"),
    ],
)
@on_one_loop
async def test_a_publisher_and_two_subscribers(
    tmp_path: Path, way: tuple[str, ...], form: str, code: int
) -> None:
    """Every subscriber receives all messages after its first one; at Ctrl-C it prints nothing more."""
    async with AsyncExitStack() as stack:
        listener = await stack.enter_async_context(running(tmp_path, *way, LESSON / f"subscriber_{form}.py"))
        await subscribed("topic")
        talker = await stack.enter_async_context(running(tmp_path, *way, LESSON / f"publisher_{form}.py"))
        await listener.line("Hello World: 0")
        other = await stack.enter_async_context(running(tmp_path, *way, LESSON / f"subscriber_{form}.py"))
        await other.line("Hello World: ")
        await listener.line(f"Hello World: {numbers(other, HEARD)[0] + 1}")
        assert [await interrupt(program) for program in (other, listener)] == [code] * 2
        await said_too(talker, listener, other)
        assert await interrupt(talker) == code
    published = numbers(talker, PUBLISHED)
    assert numbers(listener, HEARD)[0] == 0
    for program in (listener, other):
        assert_consecutive(numbers(program, HEARD), published)
        assert program.family() == []


@pytest.mark.usefixtures("daemon")
@pytest.mark.parametrize(
    ("way", "form", "code"),
    [
        (RUN, "node", -signal.SIGTERM),
        pytest.param(RUN, "member_function", 0, marks=pytest.mark.nightly),
        (FROM_INSIDE, "member_function", 0),
    ],
)
@on_one_loop
async def test_sigterm_ends_them_quietly(tmp_path: Path, way: tuple[str, ...], form: str, code: int) -> None:
    async with (
        running(tmp_path, *way, LESSON / f"subscriber_{form}.py") as listener,
        running(tmp_path, *way, LESSON / f"publisher_{form}.py") as talker,
    ):
        await listener.line("Hello World: ")
        assert await interrupt(listener, signal.SIGTERM) == code
        await said_too(talker, listener)
        assert await interrupt(talker, signal.SIGTERM) == code
    assert numbers(listener, HEARD)
    assert numbers(talker, PUBLISHED)


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_all_of_it_goes_to_stderr(tmp_path: Path) -> None:
    """stdout only has the program's own output."""
    err = tmp_path / "stderr"
    with err.open("wb") as file:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, *RUN, str(LESSON / "publisher_node.py")),
            stdout=asyncio.subprocess.PIPE,
            stderr=file,
        )
    try:
        await until(lambda: "Hello World: 1" in err.read_text())
        process.send_signal(signal.SIGINT)
        out, _ = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    assert out == b""
    assert all(PUBLISHED.fullmatch(line) for line in err.read_text().splitlines())


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_new_names_from_the_command_line(tmp_path: Path) -> None:
    rename = ("--ros-args", "-r", "topic:=/other", "-r", "__ns:=/left", "-r", "__node:=arm")
    async with (
        running(tmp_path, *RUN, LESSON / "subscriber_node.py", *rename) as listener,
        running(tmp_path, *RUN, LESSON / "publisher_node.py", *rename) as talker,
    ):
        await listener.line(STAMP + r' \[left\.arm\]: I heard: "Hello World: \d+"')
        await talker.line(STAMP + r' \[left\.arm\]: Publishing: "Hello World: 0"')


@pytest.mark.usefixtures("daemon")
@pytest.mark.parametrize("is_native", ["talker", "listener"])
@on_one_loop
async def test_one_end_of_the_native_api(tmp_path: Path, is_native: str) -> None:
    listener_command: tuple[str | Path, ...] = (*RUN, LESSON / "subscriber_node.py")
    talker_command: tuple[str | Path, ...] = (*RUN, LESSON / "publisher_node.py")
    if is_native == "talker":
        talker_command = (EXAMPLES / "talker.py",)
    else:
        listener_command = (EXAMPLES / "listener.py",)
    async with (
        running(tmp_path, *listener_command) as listener,
        running(tmp_path, *talker_command) as talker,
    ):
        heard = await listener.line(r'I heard: "(Hello World: \d+)"')
        await talker.line(f'Publishing: "{heard[1]}"')


@on_one_loop
async def test_no_daemon_need_be_started(
    tmp_path: Path, socket_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first program starts a daemon, which exits when it is no longer needed."""
    monkeypatch.delenv("BUSD_AUTOSTART")
    async with (
        running(tmp_path, *RUN, LESSON / "subscriber_node.py") as listener,
        running(tmp_path, *RUN, LESSON / "publisher_node.py"),
    ):
        await listener.line("I heard: ")


@on_one_loop
async def test_a_daemon_that_dies_and_comes_back(tmp_path: Path, daemon: Daemon, route: str) -> None:
    async with (
        running(tmp_path, *RUN, LESSON / "subscriber_node.py") as listener,
        running(tmp_path, *RUN, LESSON / "publisher_node.py") as talker,
    ):
        await listener.line("I heard: ")
        daemon.kill()
        said = len(talker.lines)
        await talker.line(f"Hello World: {said + 1}")  # it continues without a subscription
        daemon.restart()
        heard = len(listener.lines)
        await until(lambda: sum("I heard" in line for line in listener.lines[heard:]) >= 3)
        assert await interrupt(listener) == -signal.SIGINT
        assert await interrupt(talker) == -signal.SIGINT
    for program in (listener, talker):
        assert not any("Traceback" in line for line in program.lines), program.lines
    said_all = [int(n) for line in listener.lines for n in re.findall(r'"Hello World: (\d+)"', line)]
    assert said_all == sorted(set(said_all))


# --- service and client


@pytest.mark.usefixtures("daemon", "route")
@on_one_loop
async def test_a_service_and_its_client(tmp_path: Path) -> None:
    async with (
        running(tmp_path, *RUN, LESSON / "client_member_function.py", "2", "3") as early,
        running(tmp_path, *RUN, LESSON / "service_member_function.py") as service,
    ):
        assert await early.end() == 0
        async with running(tmp_path, *RUN, LESSON / "client_member_function.py", "-4", "1") as late:
            assert await late.end() == 0
        await service.line("a: -4 b: 1")
        assert await interrupt(service) == 0
    result = STAMP + r" \[minimal_client_async\]: Result of add_two_ints: for %s = %s"
    assert re.fullmatch(result % (r"2 \+ 3", "5"), early.lines[-1])
    assert re.fullmatch(result % (r"-4 \+ 1", "-3"), late.lines[-1])
    waiting = r".*\[minimal_client_async\]: service not available, waiting again\.\.\."
    assert all(re.fullmatch(waiting, line) for line in early.lines[:-1] + late.lines[:-1])
    asked = re.compile(STAMP + r" \[minimal_service\]: Incoming request\na: 2 b: 3\n(.*\n)?a: -4 b: 1")
    assert re.search(asked, "\n".join(service.lines)), service.lines


@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_ctrl_c_while_the_client_waits(tmp_path: Path) -> None:
    """There is no server, and the program does not catch the exception."""
    async with running(tmp_path, *RUN, LESSON / "client_member_function.py", "2", "3") as client:
        await client.line("waiting again")
        assert await interrupt(client) == -signal.SIGINT
    assert all("waiting again" in line for line in client.lines)
    assert client.family() == []


# --- the package


@pytest.fixture
def package_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A Python with the lesson's package: `bus pkg create`, its two files, `pip install -e`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", sources())
    for name in ("AMENT_PREFIX_PATH", "BUS_RCLPY_FORCE"):
        monkeypatch.delenv(name, raising=False)
    words = ("pkg", "create", "--build-type", "ament_python", "--license", "Apache-2.0", "py_pubsub")
    assert run_bus(*words).code == 0
    _fill(tmp_path / "py_pubsub")
    environment = tmp_path / "env"
    venv.create(environment)
    paths = [*sources().split(os.pathsep), *(path for path in sys.path if "site-packages" in path)]
    (environment / "lib" / VERSION / "site-packages" / "tests.pth").write_text("\n".join(paths))
    python = environment / "bin" / "python"
    options = ("--no-build-isolation", "--no-deps", "--no-index", "--disable-pip-version-check")
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", python, "install", *options, "-e", tmp_path / "py_pubsub"],
        capture_output=True,
        timeout=WAIT_S,
        check=True,
    )
    return python


def _fill(package: Path) -> None:
    """Adds the lesson's files and entry points."""
    scripts = ""
    for kind, name in (("publisher", "talker"), ("subscriber", "listener")):
        file = f"{kind}_member_function.py"
        (package / "py_pubsub" / file).write_bytes((LESSON / file).read_bytes())
        scripts += f"'{name} = py_pubsub.{kind}_member_function:main',"
    made = (package / "setup.py").read_text()
    filled, count = re.subn(r"(['\"]console_scripts['\"]: \[)", rf"\1{scripts}", made)
    assert count == 1, made
    (package / "setup.py").write_text(filled)


@pytest.mark.landing
@pytest.mark.skipif(
    not (importlib.util.find_spec("pip") and importlib.util.find_spec("setuptools")),
    reason="needs pip and setuptools",
)
@pytest.mark.usefixtures("daemon")
@on_one_loop
async def test_the_lessons_package(tmp_path: Path, package_python: Path) -> None:
    by_it = "import os, sys; os.execv(sys.argv[1], sys.argv[1:])"
    command = ("-c", by_it, str(package_python), *RUN, "py_pubsub")
    folder = tmp_path / "tmp"
    folder.mkdir()
    async with (
        running(folder, *command, "listener") as listener,
        running(folder, *command, "talker") as talker,
    ):
        await listener.line("I heard: ")
        assert await interrupt(listener) == 0
        await said_too(talker, listener)
        assert await interrupt(talker) == 0
    assert_consecutive(numbers(listener, HEARD), numbers(talker, PUBLISHED))
    assert_nothing_is_left(listener, folder)
    assert_nothing_is_left(talker, folder)
