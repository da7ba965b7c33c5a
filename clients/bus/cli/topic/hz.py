"""`bus topic hz`: the rate at which messages come, and beside it the rate at which they are published."""

import asyncio
from argparse import ArgumentParser, Namespace
from time import monotonic_ns, time_ns
from typing import Any

from bus.cli.completion import completed_by, topics
from bus.cli.filter import compile_filter
from bus.cli.output import dropped_text, print_json, table
from bus.cli.qosargs import add_qos_arguments, choose_profile
from bus.cli.stats import Intervals, PublishedCount, Spread
from bus.cli.stream import as_payloads, for_ever, open_node, positive_int, run_stream, wait_for_class
from bus.node import Node
from bus.subscription import Subscription

_WINDOW = 10000
_PERIOD_S = 1.0
_NS = 1e-9


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Print the average receiving rate to screen. It is the rate at which this tool receives; the rate at "
        "which the publishers publish, and what was lost between them, stand beside it."
    )
    names = parser.add_argument(
        "topic_name", nargs="+", help="Names of the topics to listen to (e.g. '/chatter')"
    )
    completed_by(names, topics)
    parser.add_argument(
        "-w",
        "--window",
        type=positive_int,
        default=_WINDOW,
        help=f"window size, in # of messages, for calculating rate (default: {_WINDOW})",
    )
    parser.add_argument("--filter", metavar="EXPR", help="only measure messages for which EXPR, over m, is true")
    parser.add_argument("--wall-time", action="store_true", help="calculate the rate using wall time")
    add_qos_arguments(parser, "subscribe", "sensor_data")


def main(args: Namespace) -> int:
    return run_stream(_measure(args))


async def _measure(args: Namespace) -> int:
    async with open_node(args) as node:
        meters = [_Meter(node, name, args) for name in dict.fromkeys(args.topic_name)]
        for meter in meters:
            await meter.open(is_one_of_many=len(meters) > 1)
        await asyncio.gather(*(meter.look() for meter in meters))
        if len(meters) > 1:
            node.create_timer(_PERIOD_S, lambda: _print_all(meters, as_json=args.json))
        while True:
            await asyncio.sleep(_PERIOD_S)
            await asyncio.gather(*(meter.look() for meter in meters))


class _Meter:
    """Measures one topic."""

    def __init__(self, node: Node, name: str, args: Namespace) -> None:
        self.topic = node.resolve_topic_name(name)
        self._node = node
        self._args = args
        self._passes = compile_filter(args.filter) if args.filter else None
        self._intervals = Intervals(args.window)
        self._clock = time_ns if args.wall_time else monotonic_ns
        self._is_alone = True
        self._subscription: Subscription[Any] | None = None
        self._published = PublishedCount()
        self._received = 0
        self._began_ns = self._looked_ns = 0
        self._samples_then = 0

    async def open(self, *, is_one_of_many: bool) -> None:
        self._is_alone = not is_one_of_many
        message_type = await wait_for_class(self._node, self.topic)
        if self._passes is None:
            as_payloads(message_type)
        profile = choose_profile(await self._node.graph(), self.topic, self._args)
        self._subscription = await self._node.create_subscription(message_type, self.topic, profile, self._hear)
        if is_one_of_many and not self._args.json:
            print(f"Subscribed to [{self.topic}]")
