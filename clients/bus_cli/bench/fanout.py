"""`bus bench fanout`: one publisher to many subscribers, at full speed and then at a fixed pace."""

from argparse import ArgumentParser, Namespace

from bus_cli.bench.measure import run_plan
from bus_cli.bench.options import add_bench_arguments, read_plan

_SUBSCRIBERS = 8
_RATE_HZ = 1000.0
_FLOOD = 0.0


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Measure one publisher to many subscribers: deliveries a second as fast as it goes, and then, at a "
        "fixed pace, how long it takes until the last subscriber has a message."
    )
    add_bench_arguments(parser, subscribers=_SUBSCRIBERS, rate=_RATE_HZ)


def main(args: Namespace) -> int:
    return run_plan(args, read_plan(args, "fanout", (_FLOOD, args.rate)))
