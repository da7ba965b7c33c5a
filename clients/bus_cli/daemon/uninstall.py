"""`bus daemon uninstall`: remove the systemd units that `bus daemon install` wrote."""

from argparse import ArgumentParser, Namespace

from bus_cli.daemon.install import add_scope, units_of
from bus_cli.daemon.units import OURS
from bus_cli.output import print_json, say
from bus_cli.units import remove, systemctl


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = "Removes the two files and prints the next command; it stops nothing."
    add_scope(parser)


def main(args: Namespace) -> int:
    units = units_of(args)
    command = systemctl(is_system=bool(units.user))
    removed = [path for path in units.paths if remove(path, OURS, "sockets.target")]
    what_next = [f"{command} stop {units.name}.socket {units.name}.service", f"{command} daemon-reload"]
    if args.json:
        print_json({"files": [str(path) for path in removed], "next": what_next if removed else []})
    elif removed:
        for path in removed:
            say(f"Removed {path}")
        say("Now type:", *what_next, sep="\n  ")
    else:
        say("No units are installed")
    return 0
