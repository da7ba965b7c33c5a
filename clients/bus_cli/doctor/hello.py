"""`bus doctor hello`: which machines receive from each other, by topic and by multicast.

Publishes a text with the name of this machine, sends it to a multicast group, and counts texts from other
machines. Only topics need a bridge.
"""

import asyncio
import os
import re
import socket
from argparse import ArgumentParser, Namespace
from collections import Counter
from contextlib import suppress

from bus.msg.std_msgs import String
from bus_cli.multicast.udp import GROUP, PORT, add_ttl_argument, receiver, send, sender
from bus_cli.output import print_json, say
from bus_cli.stream import open_node, positive, run_stream

_TOPIC = "/canyouhearme"
_EMIT_S, _PRINT_S = 0.1, 1.0
_DEPTH = 10
_MOST_BYTES = 4096
_MOST_HOSTS = 1000
"""The most machines whose messages are counted, because names come from the network."""


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Check the connection between machines. Start it on each of them: it publishes on a topic and sends "
        "to a multicast group, and prints how many messages have come from each other machine. By topic they "
        "need a bridge (bus bridge)."
    )
    parser.add_argument(
        "-t",
        "--topic",
        nargs="?",
        const=_TOPIC,
        default=_TOPIC,
        help=f"Name of ROS topic to publish to (default: '{_TOPIC}')",
    )
    parser.add_argument(
        "-ep",
        "--emit-period",
        metavar="N",
        type=positive,
        default=_EMIT_S,
        help=f"Time period to publish/send one message (default: {_EMIT_S}s)",
    )
    parser.add_argument(
        "-pp",
        "--print-period",
        metavar="N",
        type=positive,
        default=_PRINT_S,
        help=f"Time period to print summary table (default: {_PRINT_S}s)",
    )
    add_ttl_argument(parser)
    parser.add_argument(
        "-1", "--once", action="store_true", help="Publish and multicast send for one emit period then exit"
    )


def main(args: Namespace) -> int:
    return run_stream(_hello(args), only_prints=True)


class Summary:
    """Counts of one print period."""

    def __init__(self, host: str) -> None:
        self._host = host
        self.published = self.sent = 0
        self.subscribed, self.received = Counter[str](), Counter[str]()

    def hear(self, text: str, heard: Counter[str]) -> None:
        """Count a message by the last word, the name of its machine. Own messages do not count."""
        words = text.split()
        if words and words[-1] != self._host and (words[-1] in heard or len(heard) < _MOST_HOSTS):
            heard[words[-1]] += 1

    def text(self, topic: str, period_s: float) -> str:
        """The table, as ROS 2 prints it."""
        return "\n".join(
            [
                "MULTIMACHINE COMMUNICATION SUMMARY",
                f"Topic: {topic}, Published Msg Count: {self.published}",
                "Subscribed from:",
                *_rows(self.subscribed, period_s),
                f"Multicast Group/Port: {GROUP}/{PORT}, Sent Msg Count: {self.sent}",
                "Received from:",
                *_rows(self.received, period_s),
                "-" * 60,
            ]
        )

    def record(self, topic: str) -> dict[str, object]:
        """The same for JSON."""
        return {
            "topic": topic,
            "published": self.published,
            "subscribed_from": dict(self.subscribed),
            "group": GROUP,
            "port": PORT,
            "sent": self.sent,
            "received_from": dict(self.received),
        }


def _rows(heard: Counter[str], period_s: float) -> list[str]:
    counts = [("Hostname", f"Msg Count /{period_s}s"), *((name, str(heard[name])) for name in sorted(heard))]
    return [f"{'':<15} {name:<20} {count:<10}" for name, count in counts]


async def _hello(args: Namespace) -> int:
    host, loop = socket.gethostname(), asyncio.get_running_loop()
    name = f"bus_doctor_{re.sub('[^0-9a-zA-Z_]', '_', host)}_{os.getpid()}_node"
    text = f"hello, it's me {host}"
    summary = Summary(host)
    with sender(args.ttl) as out, receiver(GROUP, PORT) as source:
        source.setblocking(False)

        def on_datagram() -> None:
            with suppress(OSError):  # the kernel has dropped the datagram
                data = source.recv(_MOST_BYTES)
                summary.hear(data.decode(errors="replace"), summary.received)

        loop.add_reader(source, on_datagram)
        try:
            async with open_node(args, name) as node:
                await node.create_subscription(
                    String, args.topic, _DEPTH, lambda message: summary.hear(message.data, summary.subscribed)
                )
                publisher = await node.create_publisher(String, args.topic, _DEPTH)
                print_s = loop.time() + args.print_period
                while True:
                    await publisher.send(String(data=text))
                    summary.published += 1
                    send(out, text.encode(), GROUP, PORT)
                    summary.sent += 1
                    await asyncio.sleep(args.emit_period)
                    if args.once or loop.time() >= print_s:
                        _print(args, summary)
                        summary, print_s = Summary(host), loop.time() + args.print_period
                    if args.once:
                        return 0
        finally:
            loop.remove_reader(source)


def _print(args: Namespace, summary: Summary) -> None:
    if args.json:
        print_json(summary.record(args.topic))
    else:
        say(summary.text(args.topic, args.print_period))
