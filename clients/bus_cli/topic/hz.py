"""`bus topic hz`: the rate at which messages arrive, and the rate at which they are published."""

import asyncio
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from time import monotonic_ns, time_ns
from typing import Any

from bus.node import Node
from bus.subscription import MessageInfo, Subscription
from bus_cli.completion import completed_by, topics
from bus_cli.output import dropped_text, print_json, say, table
from bus_cli.qosargs import add_qos_arguments, given_profile
from bus_cli.stats import Flow, Intervals, Spread
from bus_cli.stream import add_window_argument, for_ever, open_node, run_stream, warn_if_unknown

_WINDOW = 10000
_PERIOD_S = 1.0
_NS = 1e-9


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Print the average receiving rate to screen. That is the rate at which this tool receives. It also "
        "prints the rate of the publishers, and the messages lost on the way."
    )
    names = parser.add_argument(
        "topic_name", nargs="+", help="Names of the topics to listen to (e.g. '/chatter')"
    )
    completed_by(names, topics)
    add_window_argument(parser, _WINDOW, "window size, in # of messages, for calculating rate")
    parser.add_argument(
        "--filter", metavar="EXPR", help="only measure messages for which EXPR, over m, is true"
    )
    parser.add_argument("--wall-time", action="store_true", help="calculate the rate using wall time")
    add_qos_arguments(parser, "subscribe", "sensor_data")


def main(args: Namespace) -> int:
    return run_stream(_measure(args), only_prints=True)


async def _measure(args: Namespace) -> int:
    passes = None
    if args.filter:
        from bus_cli.filter import compile_filter  # imports Python's parser

        passes = compile_filter(args.filter)
    async with open_node(args) as node:
        meters = [
            _Meter(node, node.resolve_topic_name(name), args) for name in dict.fromkeys(args.topic_name)
        ]
        for meter in meters:
            await meter.open(passes, on_message=_print_one if len(meters) == 1 else _say_nothing)
            if len(meters) > 1 and not args.json:
                say(f"Subscribed to [{meter.topic}]")
        if len(meters) == 1:
            return await for_ever()
        while True:
            await asyncio.sleep(_PERIOD_S)
            _print_all(meters)


class _Meter:
    """Measures one topic."""

    def __init__(self, node: Node, topic: str, args: Namespace) -> None:
        self.topic = topic
        self.intervals = Intervals(args.window)
        self.flow = Flow()
        self.as_json: bool = args.json
        self._node = node
        self._args = args
        self._subscription: Subscription[Any] | None = None

    async def open(
        self, passes: Callable[[Any], bool] | None, *, on_message: "Callable[[_Meter], None]"
    ) -> None:
        """Subscribe as soon as an endpoint has the topic. Without a filter, it decodes no message."""
        clock = time_ns if self._args.wall_time else monotonic_ns

        def on_sample(message: Any, info: MessageInfo) -> None:
            self.flow.add(info.publisher_gid, info.publication_sequence_number, info.source_timestamp)
            if passes is None or passes(message):
                self.intervals.add(clock())
                on_message(self)

        await warn_if_unknown(self._node, self.topic)
        self._subscription = await self._node.create_subscription(
            None, self.topic, given_profile(self._args), on_sample, raw=passes is None
        )

    def record(self, gaps: Spread) -> dict[str, Any]:
        published, received = self.flow.rates() or (None, None)
        return {
            "topic": self.topic,
            "rate": 1 / (gaps.mean * _NS) if gaps.mean else 0.0,
            "min_s": gaps.least * _NS,
            "max_s": gaps.most * _NS,
            "std_dev_s": gaps.deviation * _NS,
            "window": gaps.window,
            "published_hz": published,
            "received_hz": received,
            "dropped": self._subscription.statistics().dropped if self._subscription else {},
        }


def _say_nothing(meter: _Meter) -> None:
    """Do nothing at a message: several topics are printed together, once a second."""


def _print_one(meter: _Meter) -> None:
    gaps = meter.intervals.due()
    if gaps is None:
        return
    record = meter.record(gaps)
    if meter.as_json:
        print_json(record)
        return
    text = (
        f"average rate: {record['rate']:.3f}\n\tmin: {record['min_s']:.3f}s max: {record['max_s']:.3f}s "
        f"std dev: {record['std_dev_s']:.5f}s window: {record['window']}"
    )
    if record["published_hz"] is not None:
        text += f"\n\tpublished: {record['published_hz']:.3f} received: {record['received_hz']:.3f}"
        if record["dropped"]:
            text += f" dropped: {dropped_text(record['dropped'])}"
    say(text)


def _print_all(meters: list[_Meter]) -> None:
    records = [meter.record(gaps) for meter in meters if (gaps := meter.intervals.new())]
    if not records:
        return
    if meters[0].as_json:
        for record in records:
            print_json(record)
        return
    rows = [
        (
            record["topic"],
            f"{record['rate']:.3f}",
            f"{record['min_s']:.3f}",
            f"{record['max_s']:.3f}",
            f"{record['std_dev_s']:.5f}",
            str(record["window"]),
        )
        for record in records
    ]
    say(table(("topic", "rate", "min_delta", "max_delta", "std_dev", "window"), rows))
