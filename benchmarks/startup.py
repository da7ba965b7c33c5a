"""Times of starts: `bus topic list`, `bus run`, imports, first messages.

The reference is `python -c pass`, which no Python program can beat. For first messages it is the rivals.
Times are wall-clock times from the moment before the start of a process. The files are in the page cache and
compiled.
"""

import os
import select
import signal
import socket
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic_ns

import msgspec

from benchmarks import ros
from benchmarks.adapters.talkers import TALKERS
from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import ratios
from benchmarks.goals import reached
from benchmarks.harness import START_S, STOP_S, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from benchmarks.systems import (
    BUS,
    BUS_SOCKET,
    ECAL_SHIPPED,
    NATS,
    PYZMQ,
    PYZMQ_PROXY,
    RCLPY,
    REDIS,
    RIVALS,
    ROS,
    System,
)
from benchmarks.versus import against, against_best
from benchmarks.work import AT_ONCE, TOPIC, Work

NAME = "startup"
_LIMIT_S = 20.0
_PROGRAM = "benchmarks.adapters.first_message"
_TALKERS = "benchmarks.adapters.talkers"
_LISTENERS = "benchmarks.adapters.listeners"
_CREDENTIALS = struct.Struct("3i")
FIRST = Work(size=64, count=1, warm_up=0, rate=1.0, publish_by=AT_ONCE)
_PASS = "python -c pass"
_LIBRARIES = "import of the libraries"
_LISTINGS = ("bus topic list", "bus topic list, installed")
_HELP, _ECHO = "bus --help", "bus topic echo --once"
_ZMQ_ASYNCIO = "first message, pyzmq, zmq.asyncio"
_ALONE = "first message, no busd yet"
_IMPORTS = {
    _PASS: "pass",
    "import asyncio": "import asyncio",
    _LIBRARIES: "import asyncio, uvloop, msgspec, msgspec.msgpack, msgspec.json",
    "import bus": "import bus",
    "import of Node and String": "from bus import Node; from bus.msg.std_msgs import String",
    "import bus_ros.rclpy": "import bus_ros.rclpy",
}
_EMPTY, _IMPORTING, _MAKING = "an empty script", "one that imports rclpy", "one that makes a node"
_SCRIPTS = {
    _EMPTY: "",
    _IMPORTING: "import rclpy",
    _MAKING: "import rclpy; rclpy.init(); rclpy.create_node('bench').destroy_node(); rclpy.shutdown()",
}
_TALKER = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String


class MinimalPublisher(Node):
    def __init__(self):
        super().__init__("minimal_publisher")
        self.publisher_ = self.create_publisher(String, "bench", 10)
        self.timer = self.create_timer(0.001, self.timer_callback)

    def timer_callback(self):
        msg = String()
        msg.data = "Hello World: 0"
        self.publisher_.publish(msg)
        raise SystemExit


rclpy.init()
rclpy.spin(MinimalPublisher())
"""
_RUN = [sys.executable, "-m", "bus_cli", "run"]
_PYTHON_SCRIPT, _RUN_SCRIPT = f"python: {_EMPTY}", f"bus run: {_EMPTY}"
_RCLPY_FIRST = "first message, the lesson's talker by bus run"
_INSTALLED, _ROS_INSTALLED = "installed, busd", f"installed, {ROS.name}"
_COLUMNS = [Column("ms", "ms", "lower"), Column("mib", "MiB", "lower"), Column("packages", "packages")]
_QUICK_RIVALS = (PYZMQ, PYZMQ_PROXY, NATS)
_NOTES = [
    "first message: from the start of the talker's process to the message in the hands of another process, "
    "which was there before, as was the broker if there is one; each talker is the least program that its "
    "user would write, and imports nothing of the harness",
    "first message of a listener: from the start of the listener's process to a message in its hands, of a "
    "talker that was there before and sends one each millisecond; bus topic echo --once: beside this talker, "
    "until the end of the process",
    "no busd yet: one process with both ends, which starts busd in the background",
    "libraries: what asyncio and the packages that busd is built on cost by themselves",
    "installed: all packages that an installation brings, without compiled Python files",
    "the lesson's talker: as printed there, but with a period of 1 ms and not 500, and one message",
]


def run(plan: Plan) -> Section:
    """Measure each way to start."""
    cases = [
        Case(name, partial(measure_program, [sys.executable, "-c", code])) for name, code in _IMPORTS.items()
    ]
    script = Path(sys.executable).with_name("bus")
    missing = "" if script.exists() else "busd is not installed here"
    listing = [[sys.executable, "-m", "bus_cli"], [str(script)]]
    for name, command, reason in zip(_LISTINGS, listing, ("", missing), strict=True):
        cases.append(Case(name, partial(measure_program, [*command, "topic", "list"], on_bus=True), reason))
    tool = [sys.executable, "-m", "bus_cli"]
    cases.append(Case(_HELP, partial(measure_program, [*tool, "--help"])))
    cases.append(Case(_ECHO, partial(measure_beside_talker, [*tool, "topic", "echo", "--once", f"/{TOPIC}"])))
    cases.append(Case(_PYTHON_SCRIPT, partial(measure_program, [sys.executable], script="")))
    for name, code in _SCRIPTS.items():
        measure = partial(measure_program, _RUN, script=code, on_bus=name == _MAKING)
        cases.append(Case(f"bus run: {name}", measure))
    rivals = _QUICK_RIVALS if plan.quick else RIVALS
    systems = [BUS, BUS_SOCKET, *(system for system in rivals if system.fans_out)]
    for system in systems if plan.quick else [*systems, ECAL_SHIPPED, RCLPY]:
        measure = partial(measure_first_message, system)
        cases.append(Case(_first(system), measure, system.missing(), system.name))
    measure = partial(measure_first_message, PYZMQ, "zeromq_asyncio")
    cases.append(Case(_ZMQ_ASYNCIO, measure, PYZMQ.missing(), "pyzmq, zmq.asyncio"))
    for system in (BUS, BUS_SOCKET, PYZMQ):
        measure = partial(measure_listener, system)
        cases.append(Case(_listener(system), measure, system.missing(), system.name))
    cases.append(Case(_RCLPY_FIRST, measure_first_by_rclpy))
    cases.append(Case(_ALONE, measure_with_autostart))
    cases.append(Case(_INSTALLED, ros.busd_installed, rounds=1))
    cases.append(Case(_ROS_INSTALLED, ros.installed, ros.missing(), rounds=1))
    repetitions = plan.repetitions
    with compiling():
        interleave(cases, 1)  # compiles all modules
        outcomes = interleave(cases, repetitions, lambda text: plan.tell(f"startup {text}"))
    comparisons = reached(NAME, outcomes)
    for name, floor in [
        *((name, _PASS) for name in (*_LISTINGS, _HELP, _ECHO, _RUN_SCRIPT)),
        (_RUN_SCRIPT, _PYTHON_SCRIPT),
        (_first(BUS), _PASS),
        (_first(BUS), _LIBRARIES),
        (_RCLPY_FIRST, _PASS),
        (_RCLPY_FIRST, _first(BUS)),
        (_first(RCLPY), _first(ROS)),
    ]:
        if name not in outcomes or floor not in outcomes:
            continue
        values = ratios(outcomes[name].repetitions, outcomes[floor].repetitions, "ms")
        comparisons += compare(f"{name} / {floor}", values)
    for what, theirs, goal in (
        ("that import asyncio", [_first(NATS), _first(REDIS), _ZMQ_ASYNCIO], 1.0),
        ("with a broker", [_first(system) for system in systems if system.kind == "brokered"], 1.0),
        # Some of these need less time than the import of asyncio.
        ("without a broker", [_first(system) for system in systems if system.kind == "direct"], None),
    ):
        what = f"of those {what}"
        comparisons += against_best(outcomes, _first(BUS), theirs, "ms", at_most=goal, what=what)
    comparisons += against(outcomes, _INSTALLED, _ROS_INSTALLED, "mib", at_most=1.0)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, "Start: from nothing to something", _COLUMNS, rows, comparisons, _NOTES)


@contextmanager
def compiling() -> Iterator[None]:
    """Let programs keep compiled modules in a separate folder, even if the environment forbids it."""
    names = ("PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX")
    before = {name: os.environ.pop(name) for name in names if name in os.environ}
    with TemporaryDirectory(prefix="busd-bench-") as folder:
        os.environ["PYTHONPYCACHEPREFIX"] = folder
        try:
            yield
        finally:
            del os.environ["PYTHONPYCACHEPREFIX"]
            os.environ.update(before)


def measure_program(command: list[str], *, on_bus: bool = False, script: str | None = None) -> Figures:
    """The time of a program that does one thing, from start to end. Raises Failure if it does not end with 0.

    `script`: the text of a file; its name is added to the command.
    """
    with Group() as group:
        if script is not None:
            command = [*command, _write(group, script)]
        if on_bus:
            group.start_busd()
        begin_ns = monotonic_ns()
        group.wait(group.start("program", *command, ends=True), within_s=_LIMIT_S)
        return {"ms": (monotonic_ns() - begin_ns) / 1e6}


def measure_first_message(system: System, talker: str = "") -> Figures:
    """The time from the start of a talker (by default its own) until the subscriber has the message."""
    work = msgspec.structs.replace(FIRST, take_by=system.takes_by)
    name = talker or system.module.rpartition(".")[2]
    with Group() as group:
        system.start_servers(group)
        listener = system.start_role(group, "subscriber", work)
        begin_ns = monotonic_ns()
        if talker or name in TALKERS:
            group.start("talker", *system.runner, "-m", _TALKERS, name, ends=True)
        else:
            system.launch(group, "publisher", work)
        group.expect(listener, "complete", within_s=_LIMIT_S)
        listener.send("report")
        at_ns = int(group.expect(listener, "received", within_s=_LIMIT_S)["at_ns"])
    return {"ms": (at_ns - begin_ns) / 1e6}


def measure_listener(system: System) -> Figures:
    """The time from the start of a listener until it has a message of a running talker. Raises Failure."""
    name = system.module.rpartition(".")[2]
    with Group() as group:
        system.start_servers(group)
        command = (*system.runner, "-m", _LISTENERS, name)
        group.expect(group.start("talker", *command, "talk"), "ready", within_s=START_S)
        begin_ns = monotonic_ns()
        listener = group.start("listener", *command, "listen", ends=True)
        at_ns = int(group.expect(listener, "received", within_s=_LIMIT_S)["at_ns"])
    return {"ms": (at_ns - begin_ns) / 1e6}


def measure_beside_talker(command: list[str]) -> Figures:
    """As `measure_program`, on a bus with a running talker."""
    with Group() as group:
        BUS_SOCKET.start_servers(group)
        talker = group.start_python("talker", "-m", _LISTENERS, "bus_string", "talk")
        group.expect(talker, "ready", within_s=START_S)
        begin_ns = monotonic_ns()
        group.wait(group.start("program", *command, ends=True), within_s=_LIMIT_S)
        return {"ms": (monotonic_ns() - begin_ns) / 1e6}


def measure_first_by_rclpy() -> Figures:
    """As `measure_first_message` of busd, with the talker of a ROS 2 lesson."""
    with Group() as group:
        group.start_busd()
        listener = group.start_python("listener", "-m", _PROGRAM, "listener")
        group.expect(listener, "ready", within_s=START_S)
        script = _write(group, _TALKER)
        begin_ns = monotonic_ns()
        group.start("talker", *_RUN, script, ends=True)
        at_ns = int(group.expect(listener, "received", within_s=_LIMIT_S)["at_ns"])
    return {"ms": (at_ns - begin_ns) / 1e6}


def _first(system: System) -> str:
    return f"first message, {system.name}"


def _listener(system: System) -> str:
    return f"first message of a listener, {system.name}"


def _write(group: Group, code: str) -> str:
    script = group.folder / "script.py"
    script.write_text(code)
    return str(script)


def measure_with_autostart() -> Figures:
    """The time from the start of a program to its own first message, including the start of busd."""
    with Group() as group:
        path = group.folder / "busd.sock"
        environ = {"BUSD_SOCKET": str(path), "BUSD_AUTOSTART": "1"}
        begin_ns = monotonic_ns()
        try:
            command = (sys.executable, "-m", _PROGRAM, "alone")
            program = group.start("program", *command, environ=environ, ends=True)
            at_ns = int(group.expect(program, "received", within_s=_LIMIT_S)["at_ns"])
            group.wait(program, within_s=_LIMIT_S)
        finally:
            end_busd(path)
    return {"ms": (at_ns - begin_ns) / 1e6}


def end_busd(path: Path) -> None:
    """End the busd that listens at `path` and is not a child of this process, and wait for its end."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sock:
        try:
            sock.connect(str(path))
        except OSError:
            return
        pid, _, _ = _CREDENTIALS.unpack(
            sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        )
        try:
            ended = os.pidfd_open(pid)
        except ProcessLookupError:
            return
    try:
        for number in (signal.SIGTERM, signal.SIGKILL):
            signal.pidfd_send_signal(ended, number)
            poller = select.poll()
            poller.register(ended, select.POLLIN)
            if poller.poll(STOP_S * 1000):
                return
    except ProcessLookupError:
        pass
    finally:
        os.close(ended)
