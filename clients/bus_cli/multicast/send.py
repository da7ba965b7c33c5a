"""`bus multicast send`: send one UDP datagram to a multicast group."""

from argparse import ArgumentParser, Namespace

from bus_cli.multicast.udp import add_group_arguments, add_ttl_argument, check_group, send, sender
from bus_cli.output import print_json, say

_DATA = b"Hello World!"


def add_arguments(parser: ArgumentParser) -> None:
    add_group_arguments(parser)
    add_ttl_argument(parser)


def main(args: Namespace) -> int:
    check_group(args.group)
    if not args.json:
        say("Sending one UDP multicast datagram...")
    with sender(args.ttl) as through:
        send(through, _DATA, args.group, args.port)
    if args.json:
        print_json({"group": args.group, "port": args.port, "data": _DATA.decode()})
    return 0
