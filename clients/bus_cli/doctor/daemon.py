"""The daemon: whether it answers, its age, and whether it runs the files that are installed now."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from bus.base.counted import counted
from bus.base.version import RELEASE
from bus.errors import BusError, RemoteProtocolError
from bus.graph import Graph
from bus.wire import messages as m
from bus_cli.doctor import procfs
from bus_cli.doctor.finding import FULL, Finding, fail, ok, warn
from bus_cli.doctor.place import lock_of
from bus_cli.query import NotRunning, Query

__all__ = ["Seen", "examine", "others", "reach"]

_ANSWER_S = 3.0
"""Short, because the doctor has further checks if busd does not answer."""


class Seen(NamedTuple):
    """The answers of a busd; `charges` is None if busd gave none."""

    hello: m.Hello
    graph: Graph
    charges: m.Peers | None


def reach(path: Path) -> Seen | BusError:
    """Ask the busd at `path`; returns its answers, or the error."""
    try:
        with Query(path, may_start=False, answer_s=_ANSWER_S) as query:
            return Seen(query.broker, query.graph(), query.charges())
    except BusError as error:
        return error


def examine(path: Path, seen: Seen | BusError) -> Iterator[Finding]:
    """Findings about the busd at `path`."""
    if isinstance(seen, NotRunning):
        if os.environ.get("BUSD_AUTOSTART", "1") in ("0", "no", "off", "false"):
            yield warn("daemon", "not running, and BUSD_AUTOSTART is off", f"busd --socket {path}")
        else:
            yield warn("daemon", "not running; the first program that opens a node starts one")
    elif isinstance(seen, BusError):
        yield _silent(path, seen)
    else:
        pid, nodes = seen.hello.pid, len(seen.graph.nodes)
        place = f"pid {pid}" if pid else "in another PID namespace"
        text = f"{place}, protocol {seen.hello.version}, {counted(nodes, 'node')}"
        yield ok("daemon", text + _age(seen.hello))
        yield _release(seen.hello)
        yield from _replaced(seen.hello)
        yield from _open_files(pid)


def others(path: Path) -> Iterator[Finding]:
    """Other daemons of this user. Each has a separate bus, or no socket file any more."""
    sockets = procfs.listening_paths()
    found = {
        pid: procfs.listens_on(pid, sockets)
        for pid in procfs.pids_of(os.geteuid())
        if _is_busd(procfs.command_line(pid))
    }
    served = {pid: paths for pid, paths in found.items() if paths and str(path) not in paths}
    lost = {pid: paths for pid, paths in served.items() if not any(map(os.path.lexists, paths))}
    for pid, paths in sorted(lost.items()):
        text = f"busd (pid {pid}) listens on {paths[0]}, which is gone, so no program can find it"
        yield warn("other daemons", text, f"kill {pid}")
    if more := [f"pid {pid} on {paths[0]}" for pid, paths in sorted(served.items()) if pid not in lost]:
        shown = ", ".join(more[:5]) + (f" and {len(more) - 5} more" if len(more) > 5 else "")
        yield ok("other daemons", f"{shown}; their nodes and ours don't see each other")


def _silent(path: Path, error: BusError) -> Finding:
    """The finding if busd exists but gives no answers."""
    pid = procfs.number_in(str(lock_of(path)))
    if pid is not None and procfs.state(pid) in ("T", "t"):
        return fail("daemon", f"pid {pid} is stopped (SIGSTOP, Ctrl-Z or a debugger)", f"kill -CONT {pid}")
    if isinstance(error, RemoteProtocolError) or not os.access(path, os.W_OK):
        return fail("daemon", str(error))  # the error has the reason, or `permissions` has it
    known = "" if pid is None or not procfs.state(pid) else f" (pid {pid})"
    return fail("daemon", f"{error}{known}", "bus daemon stop, or kill it; see its log")


def _age_s(hello: m.Hello) -> float | None:
    """Age by busd's own report: after a restart it is the same process, but runs newer files."""
    if hello.began_ns:
        return max(0, time.monotonic_ns() - hello.began_ns) / 1e9
    return procfs.age_s(hello.pid)


def _age(hello: m.Hello) -> str:
    age_s = _age_s(hello)
    if age_s is None:
        return ""
    return f", up {age_s // 3600:.0f} h {age_s % 3600 // 60:.0f} min {age_s % 60:.0f} s"


def _release(hello: m.Hello) -> Finding:
    if hello.release == RELEASE:
        return ok("release", f"{RELEASE}, here and at the daemon")
    theirs = hello.release or "an older one, without a number"
    return warn("release", f"{RELEASE} here, the daemon's is {theirs}", "bus daemon restart")


def _replaced(hello: m.Hello) -> Iterator[Finding]:
    """Whether its files have been replaced since its start: an update does not change a running process."""
    program, age_s = procfs.executable(hello.pid), _age_s(hello)
    if program is None or age_s is None:
        return  # the process of another user, or in another namespace
    if program.endswith(" (deleted)"):
        yield warn("daemon's files", f"its Python has been replaced: {program}", "bus daemon restart")
        return
    spec = find_spec("busd")
    if spec is None or spec.origin is None or Path(program) != Path(sys.executable).resolve():
        return  # it runs from another installation
    changed = [
        file for file in Path(spec.origin).parent.rglob("*.py") if _is_newer(file, time.time() - age_s)
    ]
    if changed:
        text = f"{changed[0]} and {len(changed) - 1} more" if len(changed) > 1 else str(changed[0])
        yield warn("daemon's files", f"changed since the daemon started: {text}", "bus daemon restart")


def _is_newer(file: Path, began_s: float) -> bool:
    with suppress(OSError):
        return file.stat().st_mtime > began_s
    return False


def _open_files(pid: int) -> Iterator[Finding]:
    found = procfs.open_files(pid)
    if found is None:
        return
    used, most = found
    if used > FULL * most:
        advice = "raise LimitNOFILE in its unit, or `ulimit -Hn` in the shell that starts it"
        yield warn("daemon's open files", f"{used} of {most} in use", advice)


def _is_busd(words: list[str]) -> bool:
    """Whether a command line runs busd, as a program or as a module of Python."""
    if not words:
        return False
    names = [Path(word).name for word in words[:2]]
    return "busd" in names or any(option == "-m" and module == "busd" for option, module in pairwise(words))
