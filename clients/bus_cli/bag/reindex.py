"""`bus bag reindex`: repair a bag, and write its metadata.yaml again."""

from argparse import ArgumentParser, Namespace

from bus_cli.bag.reading import add_bag_argument
from bus_cli.output import CommandError, complain, say


def add_arguments(parser: ArgumentParser) -> None:
    add_bag_argument(parser)


def main(args: Namespace) -> int:
    from bus_bag.errors import BagError
    from bus_bag.reindex import reindex

    try:
        problems = reindex(args.bag_path, say)
    except BagError as error:
        raise CommandError(f"[ERROR] [ros2bag]: {error}") from None
    for problem in problems:
        complain(f"[WARN] [ros2bag]: {problem}")
    return 0
