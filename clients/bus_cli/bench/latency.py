"""`bus bench latency`: the age of messages at their arrival, at a fixed pace."""

from argparse import ArgumentParser, Namespace

from bus_cli.bench.measure import run_plan
from bus_cli.bench.options import add_bench_arguments, read_plan

_RATE_HZ = 1000.0


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Measure how long messages take from publisher to subscriber, published at a fixed pace."
    )
    add_bench_arguments(parser, subscribers=1, rate=_RATE_HZ)


def main(args: Namespace) -> int:
    return run_plan(args, read_plan(args, "latency", (args.rate,)))
