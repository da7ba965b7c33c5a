"""`bus topic delay`: the time between a message's `header.stamp` and its arrival here."""

from argparse import ArgumentParser, Namespace
from functools import partial
from time import time_ns
from typing import Any

from bus.subscription import Subscription
from bus_cli.completion import completed_by, topics
from bus_cli.output import CommandError, print_json, say
from bus_cli.qosargs import add_qos_arguments, given_profile
from bus_cli.stats import Delays
from bus_cli.stream import add_window_argument, open_node, run_stream, warn_if_unknown
from bus_plot.histogram import bounds, lines

_WINDOW = 10000
_PERIOD_S = 1.0
_NS = 1e-9


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(parser.add_argument("topic_name", help="Topic name to calculate the delay for"), topics)
    add_window_argument(parser, _WINDOW, "window size, in # of messages, for calculating delay")
    parser.add_argument(
        "--histogram", action="store_true", help="also print p50, p99 and a histogram of the window"
    )
    add_qos_arguments(parser, "subscribe", "sensor_data")


def main(args: Namespace) -> int:
    return run_stream(_measure(args), only_prints=True)


async def _measure(args: Namespace) -> int:
    async with open_node(args) as node:
        topic = node.resolve_topic_name(args.topic_name)
        delays = Delays(args.window)
        await warn_if_unknown(node, topic)
        subscription: Subscription[Any] = await node.create_subscription(None, topic, given_profile(args))
        if "header" not in subscription.type.__struct_fields__:
            raise CommandError("msg does not have header")
        node.create_timer(_PERIOD_S, partial(_print, topic, delays, args))
        async for message in subscription:
            try:
                stamp = message.header.stamp
                delays.add(time_ns() - stamp.sec * 1_000_000_000 - stamp.nanosec)
            except AttributeError:
                raise CommandError("header of msg does not have stamp") from None
        return 0


def _print(topic: str, delays: Delays, args: Namespace) -> None:
    if delays.is_empty:
        return
    found = delays.due()
    if found is None:
        if not args.json:
            say("no new messages")
        return
    mean, least, most, deviation = (value * _NS for value in found[:4])
    if args.json:
        record: dict[str, Any] = {
            "topic": topic,
            "delay_s": mean,
            "min_s": least,
            "max_s": most,
            "std_dev_s": deviation,
            "window": found.window,
        }
        print_json({**record, **_histogram_record(delays)} if args.histogram else record)
        return
    say(f"average delay: {mean:.3f}")
    say(f"\tmin: {least:.3f}s max: {most:.3f}s std dev: {deviation:.5f}s window: {found.window}")
    if args.histogram:
        half, high, counts = delays.histogram()
        say(f"\tp50: {half * _NS:.6f}s p99: {high * _NS:.6f}s")
        for line in lines(counts):
            say(f"\t{line}")


def _histogram_record(delays: Delays) -> dict[str, Any]:
    """`histogram` lists only parts with a delay: their bounds in seconds and the number."""
    half, high, counts = delays.histogram()
    parts = [(*bounds(part), count) for part, count in enumerate(counts) if count]
    return {
        "p50_s": half * _NS,
        "p99_s": high * _NS,
        "histogram": [[begin * _NS, end * _NS, count] for begin, end, count in parts],
    }
