"""`bus daemon uninstall`: remove the systemd units that `bus daemon install` wrote."""

from argparse import ArgumentParser, Namespace

from bus_cli.daemon.install import add_scope, units_of
from bus_cli.daemon.units import OURS
from bus_cli.output import CommandError, print_json, say


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = "Removes the two files and prints the next command; it stops nothing."
    add_scope(parser)


def main(args: Namespace) -> int:
    units = units_of(args)
    systemctl = "systemctl" if units.user else "systemctl --user"
    removed = []
    wanted = units.folder / "sockets.target.wants" / f"{units.name}.socket"
    for path in units.paths:
        try:
            if path.read_text(errors="replace").startswith(OURS):
                path.unlink()
                removed.append(path)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise CommandError(f"can't remove {path}: {error.strerror}") from None
    if removed and wanted.is_symlink():
        wanted.unlink()  # else systemd looks for the missing unit at each start
    what_next = [f"{systemctl} stop {units.name}.socket {units.name}.service", f"{systemctl} daemon-reload"]
    if args.json:
        print_json({"files": [str(path) for path in removed], "next": what_next if removed else []})
    elif removed:
        for path in removed:
            say(f"Removed {path}")
        say("Now type:", *what_next, sep="\n  ")
    else:
        say("No units are installed")
    return 0
