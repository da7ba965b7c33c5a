"""`bus bench throughput`: messages a second and losses at full speed."""

from argparse import ArgumentParser, Namespace

from bus_cli.bench.measure import run_plan
from bus_cli.bench.options import add_bench_arguments, read_plan


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Measure how many messages a second go from publisher to subscriber, losing none; "
        "with --qos-reliability best_effort, how many come and how many are lost."
    )
    add_bench_arguments(parser, subscribers=1, rate=0.0)


def main(args: Namespace) -> int:
    return run_plan(args, read_plan(args, "throughput", (args.rate,)))
