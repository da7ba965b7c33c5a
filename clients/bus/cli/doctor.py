"""`bus doctor`: looks at everything that the bus stands on, and says what to do where something is wrong."""

import os
import resource
import socket
import stat
import sys
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from bus.address import domain_id, socket_path
from bus.cli.main import version
from bus.cli.output import print_json
from bus.cli.query import NotRunning, Query
from bus.errors import BusError

_MIN_FILES = 1024
_MIN_SEND_BUFFER = 100_000
_MIN_PYTHON = (3, 11)
_RELEASED_S = 1_735_689_600
"""2025-01-01: a clock that shows less is not set."""


class Finding(NamedTuple):
    """One line: `mark` is ok, warn or fail; `advice` says what to do, where there is something to do."""

    mark: str
    subject: str
    text: str
    advice: str = ""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = "exit status: 0, or 1 where something fails"


def main(args: Namespace) -> int:
    found = list(examine(args))
    for finding in found:
        if args.json:
            print_json(finding._asdict())
        else:
            advice = f"\n       -> {finding.advice}" if finding.advice else ""
            print(f"[{finding.mark:^4}] {finding.subject}: {finding.text}{advice}")
    return 1 if any(finding.mark == "fail" for finding in found) else 0


def examine(args: Namespace) -> Iterator[Finding]:
    """All findings, most basic first."""
    try:
        path = socket_path(args.socket, args.domain)
    except BusError as error:
        yield Finding("fail", "socket", str(error), "choose another path or domain")
    else:
        yield Finding("ok", "socket", f"{path} (from {_origin(args)})")
        yield _folder(path.parent, is_default=_is_default(args))
        is_running = False
        for finding in _daemon(path):
            is_running = is_running or finding.mark == "ok"
            yield finding
        if not is_running:
            yield from _leftovers(path)
    yield from _versions()
    yield _shared_memory()
    yield from _limits()
    yield _clock()


def _is_default(args: Namespace) -> bool:
    return args.socket is None and not os.environ.get("BUSD_SOCKET")


def _origin(args: Namespace) -> str:
    if args.socket is not None:
        return "--socket"
    if os.environ.get("BUSD_SOCKET"):
        return "$BUSD_SOCKET"
    is_runtime = os.environ.get("XDG_RUNTIME_DIR", "").startswith("/")
    return f"{'$XDG_RUNTIME_DIR' if is_runtime else 'the default folder'}, domain {domain_id(args.domain)}"


def _folder(folder: Path, *, is_default: bool) -> Finding:
    """The rules by which busd refuses a folder (see docs/configuration.md)."""
    try:
        found = folder.lstat() if is_default else folder.stat()
    except FileNotFoundError:
        if is_default:
            return Finding("ok", "folder", f"{folder} is not there; busd makes it")
        return Finding("fail", "folder", f"{folder} is not there", f"mkdir -m 700 {folder}")
    except OSError as error:
        return Finding("fail", "folder", f"{folder}: {error.strerror}")
    us, mode = os.geteuid(), stat.S_IMODE(found.st_mode)
    facts = f"{folder} belongs to uid {found.st_uid}, mode {mode:04o}"
    if not stat.S_ISDIR(found.st_mode):
        return Finding(
            "fail", "folder", f"{folder} is no folder", "remove it, or set BUSD_SOCKET to another path"
        )
    if found.st_uid != us and (is_default or found.st_uid != 0):
        return Finding(
            "fail", "folder", f"{facts}; we are uid {us}", "set BUSD_SOCKET to a path in a folder of yours"
        )
    if is_default and mode & 0o077:
        return Finding("fail", "folder", f"{facts}: others may enter it", f"chmod 700 {folder}")
    if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
        return Finding("fail", "folder", f"{facts}: anybody can replace files in it", f"chmod o-w {folder}")
    return Finding("ok", "folder", facts)


def _daemon(path: Path) -> Iterator[Finding]:
    try:
        with Query(path, may_start=False) as query:
            hello, nodes = query.broker, len(query.graph().nodes)
    except NotRunning:
        if os.environ.get("BUSD_AUTOSTART", "1") in ("0", "no", "off", "false"):
            yield Finding("warn", "daemon", "not running, and BUSD_AUTOSTART is off", f"busd --socket {path}")
        else:
            yield Finding("warn", "daemon", "not running; the first program that opens a node starts one")
        return
    except BusError as error:
        yield Finding("fail", "daemon", str(error), "bus daemon stop, or kill it; see its log")
        return
    age_s = _age_s(hello.pid)
    age = (
        "" if age_s is None else f", up {age_s // 3600:.0f} h {age_s % 3600 // 60:.0f} min {age_s % 60:.0f} s"
    )
    yield Finding(
        "ok",
        "daemon",
        f"pid {hello.pid}, protocol {hello.version}, {nodes} node{'' if nodes == 1 else 's'}{age}",
    )


def _age_s(pid: int) -> float | None:
    """Seconds since a process began (proc(5)); None where it can't be seen."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK")


def _leftovers(path: Path) -> Iterator[Finding]:
    """Files of a daemon that did not end in order. The next one replaces them."""
    if not os.path.lexists(path):
        return
    if path.is_socket():
        yield Finding(
            "warn", "stale file", f"{path} was left by a dead daemon", "nothing: the next one replaces it"
        )
    else:
        yield Finding("fail", "stale file", f"{path} is in the way: it is no socket", f"rm {path}")


def _versions() -> Iterator[Finding]:
    import msgspec

    python = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info >= _MIN_PYTHON:
        yield Finding("ok", "python", f"{python} ({sys.executable})")
    else:
        yield Finding("fail", "python", python, "busd needs Python 3.11 or later")
    yield Finding("ok", "busd", version("busd") or "run from its sources, not installed")
    yield Finding("ok", "msgspec", msgspec.__version__)
    uvloop = version("uvloop")
    if uvloop is None:
        yield Finding("warn", "uvloop", "not there; asyncio's own loop is slower", "pip install uvloop")
    else:
        yield Finding("ok", "uvloop", uvloop)


def _shared_memory() -> Finding:
    """Whether messages go straight from process to process, and if not, why."""
    from bus.shm import why_not

    reason, advice = why_not(), ""
    if not reason:
        from bus.shm import segments

        try:
            segments.make_doorbell().close()
            segments.make_readers(1)[0].close()
        except OSError as error:
            reason = f"this machine gives none ({error.strerror})"
    elif os.environ.get("BUS_ROUTE") == "socket":
        advice = "unset BUS_ROUTE"
    elif os.environ.get("BUS_NATIVE") == "no":
        advice = "unset BUS_NATIVE"
    elif sys.platform == "linux":
        advice = "install busd again with BUS_NATIVE=yes; pip then says what is missing"
    if reason:
        return Finding("warn", "shared memory", f"not used: {reason}; messages go through busd", advice)
    return Finding("ok", "shared memory", "used between processes of one user")


def _limits() -> Iterator[Finding]:
    files, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files < _MIN_FILES:
        yield Finding("warn", "open files", f"limit {files}", f"ulimit -n {most if most > 0 else _MIN_FILES}")
    else:
        yield Finding("ok", "open files", f"limit {files}")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        size = probe.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
    if size < _MIN_SEND_BUFFER:
        advice = "sysctl -w net.core.wmem_default=212992"
        yield Finding("warn", "socket buffer", f"{size} bytes; large messages will be slow", advice)
    else:
        yield Finding("ok", "socket buffer", f"{size} bytes")


def _clock() -> Finding:
    if time.time() < _RELEASED_S:
        text = f"the clock shows {time.strftime('%Y-%m-%d', time.gmtime())}: stamps will be wrong"
        return Finding("warn", "clock", text, "set it, or run an NTP client")
    resolution_ns = time.get_clock_info("monotonic").resolution * 1e9
    return Finding("ok", "clock", f"set; the monotonic one counts in steps of {resolution_ns:.0f} ns")
