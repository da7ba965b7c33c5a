"""The socket: the choice of its path, its folder, its file, and leftovers of dead daemons."""

import os
import socket
import stat
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from bus.process.address import domain_id
from bus.process.logfile import find_fault, log_path
from bus_cli.doctor.finding import Finding, fail, ok, warn
from bus_cli.doctor.procfs import listening_paths

__all__ = ["folder", "is_default", "leftovers", "lock_of", "log_file", "origin", "socket_file"]


def is_default(args: Namespace) -> bool:
    """Whether the path is the default."""
    return args.socket is None and not os.environ.get("BUSD_SOCKET")


def origin(args: Namespace) -> str:
    """The source of the path: an option, a variable, or the default."""
    if args.socket is not None:
        return "--socket"
    if os.environ.get("BUSD_SOCKET"):
        return "$BUSD_SOCKET"
    is_runtime = os.environ.get("XDG_RUNTIME_DIR", "").startswith("/")
    return f"{'$XDG_RUNTIME_DIR' if is_runtime else 'the default folder'}, domain {domain_id(args.domain)}"


def folder(folder: Path, *, is_default: bool, is_served: bool) -> Finding:
    """Check the folder by busd's own rules (docs/configuration.md).

    If a busd serves there (`is_served`), the folder may belong to another user: that busd has checked it.
    """
    try:
        found = folder.lstat() if is_default else folder.stat()
    except FileNotFoundError:
        if is_default:
            return ok("folder", f"{folder} is not there; busd makes it")
        return fail("folder", f"{folder} is not there", f"mkdir -m 700 {folder}")
    except OSError as error:
        return fail("folder", f"{folder}: {error.strerror}")
    us, mode = os.geteuid(), stat.S_IMODE(found.st_mode)
    facts = f"{folder} belongs to uid {found.st_uid}, mode {mode:04o}"
    if not stat.S_ISDIR(found.st_mode):
        return fail("folder", f"{folder} is not a folder", "remove it, or set BUSD_SOCKET to another path")
    if found.st_uid != us and (is_default or (found.st_uid != 0 and not is_served)):
        return fail("folder", f"{facts}; we are uid {us}", "set BUSD_SOCKET to a path in a folder of yours")
    if is_default and mode & (0o022 if is_served else 0o077):  # [socket] may let others in
        return fail("folder", f"{facts}: others may enter it", f"chmod 700 {folder}")
    if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
        return fail("folder", f"{facts}: every user can replace files in it", f"chmod o-w {folder}")
    return ok("folder", facts)


def socket_file(path: Path) -> Iterator[Finding]:
    """Findings about the socket's file: which users may connect."""
    try:
        found = path.stat()
    except OSError:
        return
    mode = stat.S_IMODE(found.st_mode)
    facts = f"belongs to uid {found.st_uid}, gid {found.st_gid}, mode {mode:04o}"
    if not stat.S_ISSOCK(found.st_mode):
        yield fail("stale file", f"{path} is in the way: it is not a socket", f"rm {path}")
    elif not os.access(path, os.W_OK):
        yield fail(
            "permissions",
            f"{facts}; uid {os.geteuid()} may not connect",
            "its owner can let you in: [socket] mode and group, and [[access]], in busd.toml",
        )
    elif mode & stat.S_IWOTH:
        yield ok("permissions", f"{facts}: every user may connect, and do what [[access]] allows")
    else:
        yield ok("permissions", facts)


def log_file(path: Path) -> Iterator[Finding]:
    """A problem that prevents a busd of ours in the background from writing its log beside the socket."""
    is_of_others = path.exists() and path.stat().st_uid != os.geteuid()
    if not is_of_others and (fault := find_fault(log_path(path))):
        yield warn(
            "log", f"{fault}; so the log is only in memory", "move that away, then: bus daemon restart"
        )


def leftovers(path: Path, *, is_default: bool) -> Iterator[Finding]:
    """Sockets and locks of daemons that did not end in order. No busd serves `path`."""
    advice = "no action needed: the next daemon replaces it"
    if path.is_socket():
        yield warn("stale file", f"{path} was left by a dead daemon", advice)
    elif lock_of(path).exists():
        yield warn("stale file", f"{lock_of(path)} was left by a dead daemon", advice)
    if is_default:  # the folder belongs to busd
        served = set(listening_paths().values())
        for other in sorted(path.parent.glob("*.sock")):
            if other != path and str(other) not in served and _is_dead(other):
                yield warn("stale file", f"{other} was left by a dead daemon", f"rm {other}")


def _is_dead(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return path.is_socket()
        except OSError:
            pass
    return False


def lock_of(path: Path) -> Path:
    """The file that a busd at `path` locks; it contains busd's pid."""
    return path.with_name(f"{path.name}.lock")
