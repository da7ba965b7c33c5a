"""`bus multicast receive`: wait for one UDP datagram to a multicast group."""

from argparse import ArgumentParser, Namespace

from bus_cli.multicast.udp import add_group_arguments, receiver
from bus_cli.output import print_json, say

_MOST_BYTES = 4096


def add_arguments(parser: ArgumentParser) -> None:
    add_group_arguments(parser)


def main(args: Namespace) -> int:
    with receiver(args.group, args.port) as source:
        if not args.json:
            say("Waiting for UDP multicast datagram...")
        data, (host, port) = source.recvfrom(_MOST_BYTES)
    text = data.decode(errors="backslashreplace")
    if args.json:
        print_json({"host": host, "port": port, "data": text})
    else:
        say(f"Received from {host}:{port}: '{text}'")
    return 0
