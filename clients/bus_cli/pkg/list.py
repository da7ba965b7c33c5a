"""`bus pkg list`: names of packages."""

from argparse import ArgumentParser, Namespace

from bus_cli.output import show
from bus_ros import packages


def add_arguments(parser: ArgumentParser) -> None:
    pass


def main(args: Namespace) -> int:
    for name in packages.names():
        show(name, {"package": name}, as_json=args.json)
    return 0
