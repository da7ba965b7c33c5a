"""`bus component types`: the components that packages register."""

from argparse import ArgumentParser, Namespace
from itertools import groupby

from bus_cli.completion import completed_by, packages
from bus_cli.output import CommandError, print_json, say


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument(
            "package_name", nargs="?", help="Package name to look for registered components in"
        ),
        packages,
    )


def main(args: Namespace) -> int:
    from bus_ros.rclpy_components.registry import component_types

    found = component_types()
    if args.package_name is not None:
        found = [one for one in found if one.package == args.package_name]
        if not found and not _exists(args.package_name):
            from bus_cli.suggestions import near_package

            near = near_package(args.package_name)
            raise CommandError(f"Unable to find package '{args.package_name}'{near}")
    for package, types in groupby(found, lambda one: one.package):
        if args.package_name is None and not args.json:
            say(package)
        for one in types:
            if args.json:
                print_json({"package": package, "type": one.name, "target": one.target})
            else:
                say(one.name if args.package_name is not None else f"  {one.name}")
    return 0


def _exists(package: str) -> bool:
    from bus_ros import packages as installed

    return installed.executables(package) is not None or installed.source_folder(package) is not None
