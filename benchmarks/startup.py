"""How long it takes until something happens: `bus topic list`, imports, the first message of a new process.

Against `python -c pass`, which nothing written in Python can beat. Times are of the wall, from the moment
before a process is started; the files are in the page cache and compiled.
"""

import os
import select
import signal
import socket
import struct
import sys
from functools import partial
from pathlib import Path
from time import monotonic_ns

from benchmarks.cases import Case, Figures, interleave
from benchmarks.figures import ratios
from benchmarks.harness import START_S, STOP_S, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare

NAME = "startup"
_LIMIT_S = 20.0
_PROGRAM = "benchmarks.adapters.first_message"
_CREDENTIALS = struct.Struct("3i")
_PASS = "python -c pass"
_LIBRARIES = "import of the libraries"
_LISTINGS = ("bus topic list", "bus topic list, installed")
_FIRST = "first message, busd running"
_IMPORTS = {
    _PASS: "pass",
    "import asyncio": "import asyncio",
    _LIBRARIES: "import asyncio, uvloop, msgspec, msgspec.msgpack, msgspec.json",
    "import bus": "import bus",
    "import of Node and String": "from bus import Node; from bus.msg.std_msgs import String",
}
_COLUMNS = [Column("ms", "ms")]
_NOTES = [
    "first message, busd running: from the start of the talker's process to the message in another process's "
    "hands; no busd: one process with both ends, which starts busd in the background",
    "libraries: what asyncio and the packages that busd is built on cost by themselves",
]
_IMPORTS = {
    "python -c pass": "pass",
    "import asyncio": "import asyncio",
    "import of the libraries": "import asyncio, uvloop, msgspec, msgspec.msgpack, msgspec.json",
    "import bus": "import bus",
    "import of Node and String": "from bus import Node; from bus.msg.std_msgs import String",
}


def run(plan: Plan) -> Section:
    """Measure each way to begin."""
    cases = [
        Case(name, partial(measure_program, [sys.executable, "-c", code])) for name, code in _IMPORTS.items()
    ]
    script = Path(sys.executable).with_name("bus")
    missing = "" if script.exists() else "busd is not installed here"
    listing = [[sys.executable, "-m", "bus.cli"], [str(script)]]
    for name, command, reason in zip(_LISTINGS, listing, ("", missing), strict=True):
        cases.append(Case(name, partial(measure_program, [*command, "topic", "list"], on_bus=True), reason))
    cases.append(Case(_FIRST, measure_first_message))
    cases.append(Case("first message, no busd yet", measure_with_autostart))
    repetitions = plan.repetitions * plan.choose(2, 3)
    outcomes = interleave(cases, repetitions, lambda text: plan.tell(f"startup {text}"))
    comparisons = []
    for name, floor in [(name, _PASS) for name in _LISTINGS] + [(_FIRST, _PASS), (_FIRST, _LIBRARIES)]:
        values = ratios(outcomes[name].repetitions, outcomes[floor].repetitions, "ms")
        comparisons += compare(f"{name} / {floor}", values)
    rows = [Row.of(outcomes[case.name]) for case in cases]
    return Section(NAME, "Start: from nothing to something", _COLUMNS, rows, comparisons, _NOTES)


def measure_program(command: list[str], *, on_bus: bool = False) -> Figures:
    """From start to end of a program that does one thing. Raises Failure where it does not end with 0."""
    with Group() as group:
        if on_bus:
            group.start_busd()
        begin_ns = monotonic_ns()
        group.wait(group.start("program", *command, ends=True), within_s=_LIMIT_S)
        return {"ms": (monotonic_ns() - begin_ns) / 1e6}


def measure_first_message() -> Figures:
    """From the start of a talker to the message in the hands of a listener that was there."""
    with Group() as group:
        group.start_busd()
        listener = group.start_python("listener", "-m", _PROGRAM, "listener")
        group.expect(listener, "ready", within_s=START_S)
        begin_ns = monotonic_ns()
        group.start("talker", sys.executable, "-m", _PROGRAM, "talker", ends=True)
        at_ns = int(group.expect(listener, "received", within_s=_LIMIT_S)["at_ns"])
    return {"ms": (at_ns - begin_ns) / 1e6}


def measure_with_autostart() -> Figures:
    """From the start of a program to its own first message, with busd started on the way."""
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
    """End the busd that listens at `path`, which is no child of ours, and wait until it has gone."""
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
