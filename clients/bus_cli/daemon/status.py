"""`bus daemon status`: whether a daemon runs."""

from argparse import ArgumentParser, Namespace

from bus.process.address import socket_path
from bus_cli.output import print_json, say
from bus_cli.query import NotRunning, Query


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = "exit status: 0 running, 1 not running"


def main(args: Namespace) -> int:
    path = socket_path(args.socket, args.domain)
    try:
        with Query(path, may_start=False) as query:
            pid = query.broker.pid
    except NotRunning:
        pid = None
    if args.json:
        print_json({"running": pid is not None, "pid": pid, "socket": str(path)})
    else:
        say("The daemon is running" if pid is not None else "The daemon is not running")
    return 0 if pid is not None else 1
