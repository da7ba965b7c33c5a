"""`bus daemon install`: write systemd units that start the daemon when a first program connects."""

import grp
import os
import pwd
from argparse import ArgumentParser, Namespace
from pathlib import Path

from bus.errors import BusError
from bus.process.address import domain_id, socket_path
from bus_cli.configuration import ask
from bus_cli.daemon.units import Units, systemd_version
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.query import NotRunning, Query
from bus_cli.units import systemctl, write


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = "Writes two files and prints the next command; it starts nothing."
    add_scope(parser)
    parser.add_argument("--config", metavar="FILE", help="limits, topic and access rules (busd.toml)")
    parser.add_argument("--dry-run", action="store_true", help="print the files, and write nothing")


def add_scope(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--system", action="store_true", help="install for the machine instead of the current user"
    )
    parser.add_argument(
        "--user",
        metavar="NAME",
        help="with --system: user that runs the daemon; this user's programs have full access",
    )
    parser.add_argument(
        "--group", metavar="NAME", help="with --system: group that can connect (default: the user's own)"
    )


def units_of(args: Namespace) -> Units:
    """Make the units from the options. Raises CommandError for names that contradict or do not exist."""
    if args.socket:
        raise CommandError("a unit's socket is chosen by --domain and --system, not by --socket")
    domain = domain_id(args.domain)
    if not args.system:
        if args.user or args.group:
            raise CommandError("--user and --group are for --system")
        return Units(domain=domain)
    if not args.user:
        raise CommandError(
            "--system needs --user, the user that runs the daemon (not root: it needs no rights)"
        )
    try:
        user = pwd.getpwnam(args.user)
    except KeyError:
        raise CommandError(f"there is no user {args.user!r}") from None
    try:
        group = grp.getgrnam(args.group) if args.group else grp.getgrgid(user.pw_gid)
    except KeyError:
        raise CommandError(f"there is no group {args.group or user.pw_gid!r}") from None
    return Units(domain=domain, user=user.pw_name, group=group.gr_name)


def main(args: Namespace) -> int:
    units = units_of(args)
    if args.config:
        config = Path(args.config).absolute()
        if not config.is_file():
            raise CommandError(f"{args.config} is not there")
        units = Units(units.domain, units.user, units.group, config)
        _check(config, Path(units.socket.replace("%t", f"/run/user/{os.getuid()}")))
    texts = units.texts(units.command(), systemd_version())
    if args.dry_run and args.json:
        print_json({"files": {str(path): text for path, text in texts.items()}})
        return 0
    if args.dry_run:
        say("\n".join(f"# {path}\n{text}" for path, text in texts.items()), end="")
        return 0
    for path, text in texts.items():
        write(path, text)
    what_next = _what_next(units)
    if args.json:
        print_json({"files": [str(path) for path in texts], "next": what_next})
    else:
        for path in texts:
            say(f"Wrote {path}")
        say("Now type:", *what_next, sep="\n  ")
        if units.user:
            say(f"Programs find it with: export BUSD_SOCKET={units.socket}")
    return 0


def _check(config: Path, socket: Path) -> None:
    """Check the configuration now, before systemd starts busd with it. Raises CommandError with its fault."""
    opinion = ask(config, socket)
    if opinion.fault:
        raise CommandError(opinion.fault)
    for doubt in opinion.doubts:
        complain(doubt)


def _what_next(units: Units) -> list[str]:
    command = systemctl(is_system=bool(units.user))
    lines = [f"{command} daemon-reload", f"{command} enable --now {units.name}.socket"]
    return ["bus daemon stop", *lines] if not units.user and _runs(units.domain) else lines


def _runs(domain: int) -> bool:
    """Whether a busd already listens on the socket for systemd."""
    try:
        with Query(socket_path(None, domain), may_start=False):
            return True
    except NotRunning:
        return False
    except BusError:
        return True
