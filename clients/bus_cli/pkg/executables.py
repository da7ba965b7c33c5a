"""`bus pkg executables`: programs of packages."""

from argparse import ArgumentParser, Namespace

from bus_cli import completion
from bus_cli.completion import completed_by
from bus_cli.output import CommandError, print_json, say
from bus_ros import packages


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(parser.add_argument("package_name", nargs="?", help="The package name"), completion.packages)
    parser.add_argument("--full-path", action="store_true", help="Show full path of each executable")


def main(args: Namespace) -> int:
    chosen = packages.names() if args.package_name is None else [args.package_name]
    for package in chosen:
        found = packages.executables(package)
        if found is None:
            from bus_cli.suggestions import near_package

            raise CommandError(f"Package '{package}' not found{near_package(package)}")
        for one in found:
            if args.json:
                print_json({"package": package, "executable": one.name, "path": one.path})
            else:
                say(one.path if args.full_path else f"{package} {one.name}")
    return 0
