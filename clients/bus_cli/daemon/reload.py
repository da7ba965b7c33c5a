"""`bus daemon reload`: let the daemon read its configuration again."""

from argparse import ArgumentParser, Namespace

from bus.process.address import socket_path
from bus.wire.messages import Done, Reload
from bus_cli.output import CommandError, print_json, say
from bus_cli.query import NotRunning, Query


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = "The same as SIGHUP. If the file is wrong, the daemon keeps its configuration."


def main(args: Namespace) -> int:
    path = socket_path(args.socket, args.domain)
    try:
        query = Query(path, may_start=False)
    except NotRunning:
        raise CommandError("The daemon is not running") from None
    with query:
        if not query.broker.release:
            raise CommandError("the daemon's release can't reload: stop and start it")
        changes = query.request(lambda number: Reload(request=number), Done).text
    if args.json:
        print_json({"changes": changes, "pid": query.broker.pid, "socket": str(path)})
    else:
        say(f"The daemon has reloaded its configuration: {changes}")
    return 0
