"""`bus daemon start`: start a busd in the background that runs until it is stopped.

A busd that a program starts (`bus.link.autostart`) exits when idle. This one does not, and it takes options.
"""

import asyncio
from argparse import ArgumentParser, Namespace
from pathlib import Path

from bus.errors import BrokerUnavailable
from bus.link.autostart import start
from bus.process.address import socket_path
from bus_cli.output import CommandError, print_json, say
from bus_cli.query import NotRunning, Query


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--config", metavar="FILE", help="limits and topic rules (see busd --help)")
    parser.add_argument(
        "--log-level", metavar="LEVEL", help="lowest level of lines in busd's log (see busd --help)"
    )
    parser.add_argument(
        "-d", "--debug", action="store_true", help="the same as --log-level debug, for busd's log"
    )
    parser.add_argument("--log-format", metavar="FORMAT", help="format of busd's log (see busd --help)")


def main(args: Namespace) -> int:
    path = socket_path(args.socket, args.domain)
    pid = _pid(path)
    is_new = pid is None
    if is_new:
        options = {
            "--config": args.config,
            "--log-level": "debug" if args.debug else args.log_level,
            "--log-format": args.log_format,
        }
        try:
            asyncio.run(start(path, [f"{name}={value}" for name, value in options.items() if value]))
        except BrokerUnavailable as error:
            raise CommandError(str(error)) from None
        pid = _pid(path)
    if args.json:
        print_json({"started": is_new, "pid": pid, "socket": str(path)})
    else:
        say("The daemon has been started" if is_new else "The daemon is already running")
    return 0


def _pid(path: Path) -> int | None:
    try:
        with Query(path, may_start=False) as query:
            return query.broker.pid
    except NotRunning:
        return None
