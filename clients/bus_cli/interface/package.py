"""`bus interface package`: the definitions in a package."""

from argparse import ArgumentParser, Namespace
from typing import Any

from bus_cli.completion import completed_by
from bus_cli.interface.list import add_kinds, wanted_kinds
from bus_cli.output import CommandError, show


def add_arguments(parser: ArgumentParser) -> None:
    add_kinds(parser, "Print out only the {} types")
    completed_by(
        parser.add_argument("package_name", help="Name of the ROS package (e.g. 'example_interfaces')"),
        _packages,
    )


def main(args: Namespace) -> int:
    from bus.types.definitions import names

    if not names(package=args.package_name):
        from bus_cli.suggestions import near_interface_package

        near = near_interface_package(args.package_name)
        raise CommandError(f"Unknown package '{args.package_name}'{near}")
    for kind in wanted_kinds(args):
        for name in names(kind, args.package_name):
            show(name, {"type": name, "kind": kind}, as_json=args.json)
    return 0


def _packages(**_: Any) -> list[str]:
    from bus.types.definitions import packages

    return packages()
