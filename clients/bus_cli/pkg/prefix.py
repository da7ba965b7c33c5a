"""`bus pkg prefix`: the folder into which a package is installed."""

from argparse import ArgumentParser, Namespace

from bus_cli.completion import completed_by
from bus_cli.output import CommandError, show
from bus_ros import packages


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("package_name", help="The package name"), lambda prefix, **_: packages.names()
    )
    parser.add_argument("--share", action="store_true", help="Show share directory for the package")


def main(args: Namespace) -> int:
    prefix = packages.find_prefix(args.package_name)
    if prefix is None:
        from bus_cli.suggestions import near_package

        raise CommandError(f"Package not found{near_package(args.package_name)}")
    path = f"{prefix.path}/share/{args.package_name}" if args.share else str(prefix.path)
    show(path, {"package": args.package_name, "prefix": path}, as_json=args.json)
    return 0
