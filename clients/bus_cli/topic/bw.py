"""`bus topic bw`: bytes per second on a topic, and the encoded sizes of its messages."""

from argparse import ArgumentParser, Namespace
from time import monotonic_ns

from bus_cli.completion import completed_by, topics
from bus_cli.output import in_unit, print_json, say, unit_of
from bus_cli.qosargs import add_qos_arguments, given_profile
from bus_cli.stats import Bandwidth
from bus_cli.stream import add_window_argument, for_ever, open_node, run_stream, warn_if_unknown

_WINDOW = 100
_PERIOD_S = 1.0


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("topic_name", help="Topic name to monitor for bandwidth utilization"), topics
    )
    add_window_argument(parser, _WINDOW, "maximum window size, in # of messages, for calculating rate")
    add_qos_arguments(parser, "subscribe", "sensor_data")


def main(args: Namespace) -> int:
    return run_stream(_measure(args), only_prints=True)


async def _measure(args: Namespace) -> int:
    async with open_node(args) as node:
        topic = node.resolve_topic_name(args.topic_name)
        bandwidth = Bandwidth(args.window)

        def on_message(payload: bytes) -> None:
            bandwidth.add(monotonic_ns(), len(payload))

        await warn_if_unknown(node, topic)
        await node.create_subscription(None, topic, given_profile(args), on_message, raw=True)
        if not args.json:
            say(f"Subscribed to [{topic}]")
        node.create_timer(_PERIOD_S, lambda: _print(topic, bandwidth, as_json=args.json))
        return await for_ever()


def _print(topic: str, bandwidth: Bandwidth, *, as_json: bool) -> None:
    found = bandwidth.rate(monotonic_ns())
    if found is None:
        return
    rate, sizes = found
    if as_json:
        print_json(
            {
                "topic": topic,
                "bytes_per_s": rate,
                "messages": sizes.window,
                "mean": sizes.mean,
                "min": sizes.least,
                "max": sizes.most,
            }
        )
        return
    # Use the unit of the rate for all numbers, like ros2.
    unit = unit_of(rate)
    mean, least, most = (in_unit(size, unit) for size in (sizes.mean, sizes.least, sizes.most))
    say(f"{in_unit(rate, unit)}/s from {sizes.window} messages")
    say(f"\tMessage size mean: {mean} min: {least} max: {most}")
