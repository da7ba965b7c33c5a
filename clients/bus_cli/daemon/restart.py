"""`bus daemon restart`: the daemon starts the release installed now, which takes over its socket."""

from argparse import ArgumentParser, Namespace
from pathlib import Path

from bus.errors import BrokerUnavailable
from bus.process.address import socket_path
from bus.wire.messages import Done, StopBroker
from bus_cli.output import CommandError, print_json, say
from bus_cli.query import NotRunning, Query

_RESTART_S = 30.0
"""Time limit for a check that the new daemon can start, the end of the old one, and the start."""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = (
        "The new daemon has the options and the process id of the old one. Nodes reconnect by themselves; "
        "messages by shared memory continue. If the new busd can't start, the old one stays."
    )


def main(args: Namespace) -> int:
    path = socket_path(args.socket, args.domain)
    before = _restart(path)
    with Query(path, may_start=False, answer_s=_RESTART_S) as query:
        pid, release = query.broker.pid, query.broker.release
    if args.json:
        print_json({"pid": pid, "socket": str(path), "release": release, "release_before": before})
    elif release != before:
        say(f"The daemon has been restarted: busd {release}, before it was {before}")
    else:
        say("The daemon has been restarted")
    return 0


def _restart(path: Path) -> str:
    """Restart the daemon; returns the release of the old one."""
    try:
        query = Query(path, may_start=False, answer_s=_RESTART_S)
    except NotRunning:
        raise CommandError("The daemon is not running") from None
    with query:
        if not query.broker.release:
            raise CommandError("the daemon's release can't restart: stop and start it")
        query.request(lambda number: StopBroker(request=number, restart=True), Done)
        try:
            query.wait_for_end()
        except BrokerUnavailable:
            raise CommandError(
                f"busd (pid {query.broker.pid}) was asked to restart but has not done so in {_RESTART_S:g} s"
            ) from None
    return query.broker.release
