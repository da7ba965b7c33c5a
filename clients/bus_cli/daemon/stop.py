"""`bus daemon stop`: ask the daemon to stop, and wait for its end."""

import os
import select
from argparse import ArgumentParser, Namespace
from pathlib import Path
from time import monotonic, sleep

from bus.process.address import socket_path
from bus.wire.messages import Done, StopBroker
from bus_cli.output import CommandError, print_json, say
from bus_cli.query import NotRunning, Query

__all__ = ["add_arguments", "main", "stop"]

_STOP_S = 10.0
_LOOK_S = 0.02


def add_arguments(parser: ArgumentParser) -> None:
    """This verb only has the common options."""


def main(args: Namespace) -> int:
    path = socket_path(args.socket, args.domain)
    pid = stop(path)
    if args.json:
        print_json({"stopped": pid is not None, "pid": pid, "socket": str(path)})
    else:
        say("The daemon is not running" if pid is None else "The daemon has been stopped")
    return 0


def stop(path: Path) -> int | None:
    """Stop the daemon at `path`; returns its pid, or None if none ran. Raises CommandError if it goes on."""
    try:
        query = Query(path, may_start=False)
    except NotRunning:
        return None
    with query:
        pid = query.broker.pid
        try:
            process: int | None = os.pidfd_open(pid)
        except OSError:  # it lives in another pid namespace
            process = None
        try:
            query.request(lambda number: StopBroker(request=number), Done)
            if not _wait(path, process):
                which = f" (pid {pid})" if pid else ""
                raise CommandError(f"busd{which} was asked to stop but is still there after {_STOP_S:g} s")
        finally:
            if process is not None:
                os.close(process)
    return pid


def _wait(path: Path, process: int | None) -> bool:
    """Wait for the end of the process. If it can't be watched, wait until its socket is gone."""
    if process is not None:
        return bool(select.select([process], [], [], _STOP_S)[0])
    end_s = monotonic() + _STOP_S
    while path.exists() and monotonic() < end_s:
        sleep(_LOOK_S)
    return not path.exists()
