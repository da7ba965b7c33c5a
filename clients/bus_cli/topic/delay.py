"""`bus topic delay`: the time between a message's `header.stamp` and its arrival here."""

from argparse import ArgumentParser, Namespace
from time import time_ns
from typing import Any

from bus.subscription import Subscription
from bus_cli.completion import completed_by, topics
from bus_cli.output import CommandError, print_json, say
from bus_cli.qosargs import add_qos_arguments, given_profile
from bus_cli.stats import Delays
from bus_cli.stream import add_window_argument, open_node, run_stream, warn_if_unknown

_WINDOW = 10000
_PERIOD_S = 1.0
_NS = 1e-9


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(parser.add_argument("topic_name", help="Topic name to calculate the delay for"), topics)
    add_window_argument(parser, _WINDOW, "window size, in # of messages, for calculating delay")
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
        node.create_timer(_PERIOD_S, lambda: _print(topic, delays, as_json=args.json))
        async for message in subscription:
            stamp = message.header.stamp
            delays.add(time_ns() - stamp.sec * 1_000_000_000 - stamp.nanosec)
        return 0


def _print(topic: str, delays: Delays, *, as_json: bool) -> None:
    if delays.is_empty:
        return
    found = delays.due()
    if found is None:
        if not as_json:
            say("no new messages")
        return
    mean, least, most, deviation = (value * _NS for value in found[:4])
    if as_json:
        print_json(
            {
                "topic": topic,
                "delay_s": mean,
                "min_s": least,
                "max_s": most,
                "std_dev_s": deviation,
                "window": found.window,
            }
        )
        return
    say(f"average delay: {mean:.3f}")
    say(f"\tmin: {least:.3f}s max: {most:.3f}s std dev: {deviation:.5f}s window: {found.window}")
