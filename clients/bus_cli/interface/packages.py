"""`bus interface packages`: names of packages with definitions."""

from argparse import ArgumentParser, Namespace

from bus_cli.interface.list import add_kinds, wanted_kinds
from bus_cli.output import show


def add_arguments(parser: ArgumentParser) -> None:
    add_kinds(parser, "Only list packages that have {} types")


def main(args: Namespace) -> int:
    from bus.types.definitions import names

    found = {name.partition("/")[0] for kind in wanted_kinds(args) for name in names(kind)}
    for package in sorted(found):
        show(package, {"package": package}, as_json=args.json)
    return 0
