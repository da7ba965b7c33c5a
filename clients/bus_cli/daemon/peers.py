"""`bus daemon peers`: resources that the daemon holds for each process, or for each user."""

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from typing import Any

from bus.process.address import socket_path
from bus_cli.output import CommandError, print_json, say, size_text, table
from bus_cli.query import Query

_OF_PEERS = ("pid", "uid", "program", "nodes", "endpoints", "topics", "descriptors")
_OF_USERS = ("uid", "connections", "endpoints", "topics", "descriptors", "absent")
_HELD = ("queued_bytes", "history_bytes", "refused")
_SILENT = "silent_s"


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = (
        "In brackets: the used part of a limit, from a tenth on (busd.toml, [limits]). "
        "Only the daemon's own user and root see processes of other users."
    )
    parser.add_argument("--users", action="store_true", help="Sums of all processes of each user")


def main(args: Namespace) -> int:
    with Query(socket_path(args.socket, args.domain), may_start=False) as query:
        charges = query.charges()
    if charges is None:
        raise CommandError("this busd is too old to report the resources of each process")
    records: Sequence[Any] = charges.users
    if not args.users:  # without this process, which only asks
        records = [peer for peer in charges.peers if peer.pid != os.getpid()]
    if args.json:
        for record in records:
            print_json({name: getattr(record, name) for name in record.__struct_fields__})
        return 0
    columns = (*_OF_USERS, *_HELD) if args.users else (*_OF_PEERS, *_HELD, _SILENT)
    suffix = "_per_user" if args.users else "_per_peer"
    rows = [[_cell(record, name, suffix, charges.limits) for name in columns] for record in records]
    say(table([name.removesuffix("_bytes").removesuffix("_s") for name in columns], rows), end="")
    return 0


def _cell(record: Any, name: str, suffix: str, limits: Mapping[str, int | float]) -> str:
    value, most = getattr(record, name), limits.get(name + suffix)
    if name == _SILENT:  # a shorter silence is normal
        return f"{value:.0f} s" if value >= limits.get("lease_s", 0) else ""
    text = size_text(value) if name.endswith("_bytes") else str(value)
    part = value / most if most else 0
    return f"{text} ({part:.0%})" if part >= 0.1 else text
