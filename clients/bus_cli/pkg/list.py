"""`bus pkg list`."""

from argparse import ArgumentParser, Namespace

from bus_cli.output import print_json, say
from bus_ros import packages


def add_arguments(parser: ArgumentParser) -> None:
    pass


def main(args: Namespace) -> int:
    for name in packages.names():
        if args.json:
            print_json({"package": name})
        else:
            say(name)
    return 0
