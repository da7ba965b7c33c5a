"""`bus daemon start`: a busd in the background that stays until it is stopped.

Unlike the one that a program starts (`bus.autostart`), it has no idle exit and may be given options.
"""

import os
import select
import socket
import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from subprocess import DEVNULL, Popen

from bus.address import socket_path
from bus.cli.output import CommandError, print_json
from bus.cli.query import NotRunning, Query

_START_S = 10.0
_ALREADY_RUNNING = 3  # busd.run.EXIT_ALREADY_RUNNING


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--config", metavar="FILE", help="limits and topic rules (see busd --help)")
    parser.add_argument(
        "--log-level", metavar="LEVEL", help="how much busd writes into its log (see busd --help)"
    )


def main(args: Namespace) -> int:
    path = socket_path(args.socket, args.domain)
    pid = _pid(path)
    is_new = pid is None
    if is_new:
        options = {"--config": args.config, "--log-level": args.log_level}
        _start(path, [f"{name}={value}" for name, value in options.items() if value])
        pid = _pid(path)
    if args.json:
        print_json({"started": is_new, "pid": pid, "socket": str(path)})
    else:
        print("The daemon has been started" if is_new else "The daemon is already running")
    return 0


def _pid(path: Path) -> int | None:
    try:
        with Query(path, may_start=False) as query:
            return query.broker.pid
    except NotRunning:
        return None


def _start(path: Path, options: list[str]) -> None:
    """Start busd in a session of its own and wait until it says that it is ready, or ends."""
    log = path.with_suffix(".log")
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready:
        ready.bind("")  # an abstract address that the kernel chooses
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW
        with os.fdopen(os.open(log, flags, 0o600), "wb") as stderr:
            process = Popen(
                [sys.executable, "-m", "busd", "--socket", str(path), *options],
                env={**os.environ, "NOTIFY_SOCKET": "@" + ready.getsockname()[1:].decode()},
                stdin=DEVNULL,
                stdout=DEVNULL,
                stderr=stderr,
                start_new_session=True,
            )
        ended = os.pidfd_open(process.pid)
        try:
            if not select.select([ready.fileno(), ended], [], [], _START_S)[0]:
                raise CommandError(
                    f"busd (pid {process.pid}) did not become ready within {_START_S:g} s; see {log}"
                )
        finally:
            os.close(ended)
    # Another one may have been faster: then ours is gone, and that one is as good.
    if process.poll() not in (None, _ALREADY_RUNNING):
        lines = log.read_text(errors="replace").splitlines() or [f"see {log}"]
        raise CommandError(f"busd could not be started at {path}: {lines[-1].removeprefix('busd: ')}")
    process.returncode = 0  # it shall outlive us: no ResourceWarning
