"""Shared code of the verbs that run a bridge: their options, and the file to which they add them."""

import signal
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bus.process.address import socket_path
from bus_cli.bridge.service import add_service_arguments, change_service, option, words_of
from bus_cli.completion import completed_by, topics
from bus_cli.output import CommandError
from bus_cli.query import NotRunning, Query
from bus_cli.stream import run_stream

if TYPE_CHECKING:
    from argparse import _ArgumentGroup as ArgumentGroup

    from bus_bridge.options import BridgeTable

__all__ = ["add_bridge_arguments", "add_certificate_arguments", "config_file", "run_bridge", "tls_of"]

_LEVELS = ("debug", "info", "warn", "error", "fatal")


def add_bridge_arguments(parser: ArgumentParser, engine: str) -> None:
    """Add the options. `engine` is its name for users."""
    group = parser.add_argument_group("what crosses")
    group.add_argument(
        "--namespace",
        metavar="NS",
        help="prefix added to names on the far side, and removed from names that come from there",
    )
    for flag, text in (
        ("--allow", "only topics and services that match, as '/camera/**'"),
        ("--deny", "none that match, even if --allow has them"),
    ):
        action = group.add_argument(
            flag, action="append", metavar="PATTERN", help=f"{text}; may be given several times"
        )
        completed_by(action, topics)
    group = parser.add_argument_group("how to run")
    group.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help=f"a file with [bridge.{engine}] (default: busd's file)",
    )
    group.add_argument(
        "--id", metavar="ID", help="name of this bus for other buses (default: from the machine's name)"
    )
    group.add_argument("--log-level", choices=_LEVELS, default="info", help="logging level")
    add_service_arguments(parser)


def add_certificate_arguments(group: "ArgumentGroup") -> None:
    """Add the options for certificates of zenoh's links, and for links without them."""
    group.add_argument(
        "--ca", metavar="FILE", help="CA certificate (PEM) that has signed the certificates of both sides"
    )
    group.add_argument("--certificate", metavar="FILE", help="this side's certificate (PEM)")
    group.add_argument("--key", metavar="FILE", help="the private key of --certificate (PEM)")
    group.add_argument(
        "--insecure",
        action="store_true",
        default=None,
        help="allow addresses without certificates: any program that reaches them can read and publish",
    )


def tls_of(args: Namespace) -> dict[str, str] | None:
    """The options for certificates, by the keys of the table."""
    given = {name: value for name in ("ca", "certificate", "key") if (value := getattr(args, name))}
    return given or None


def run_bridge(args: Namespace, engine: str, flags: dict[str, Any]) -> int:
    """Run a bridge until a signal, or change its unit.

    `flags`: further options of the command line, by the keys of busd.toml.
    """
    from bus.process.terminal import has_terminal
    from bus_bridge.config import TABLES, load, merged
    from bus_bridge.extras import EXTRAS, why_missing

    if not args.service and not has_terminal():
        signal.signal(signal.SIGHUP, signal.SIG_IGN)  # a reload that comes too early must not end the bridge
    path = socket_path(args.socket, args.domain)
    options = _from_flags(TABLES[engine], args, flags)
    if args.service:
        return change_service(args, engine, words_of(flags | _how_to_run(args, TABLES[engine])))
    if not EXTRAS[engine].is_optional and (why := why_missing(engine)):
        raise CommandError(why)
    from bus_bridge.program import Plan
    from bus_bridge.reloading import Source

    table, source = options, None
    if file := args.config or config_file(path):
        source = Source(file, lambda: merged(load(file, TABLES[engine]), options))
        table = source.load()
    plan = Plan(engine, table)
    with Query(path):  # starts a busd if none runs; busd makes the folder that gives the bus its id
        pass
    run_stream(plan.run(path, args.log_level, source))
    return 0


def _how_to_run(args: Namespace, kind: "type[BridgeTable]") -> dict[str, Any]:
    """The options that are no keys of the table, for a unit. Raises BridgeError for a wrong file."""
    from bus_bridge.config import load

    if args.config is None:
        return {"log_level": args.log_level}
    load(args.config, kind)
    return {"config": args.config.absolute(), "log_level": args.log_level}


def config_file(path: Path) -> Path | None:
    """The configuration file of the busd at `path`; None if no busd runs, or if it has no file."""
    from bus_cli.doctor.configuration import file_of_daemon

    try:
        with Query(path, may_start=False) as query:
            return file_of_daemon(query.broker.pid)
    except NotRunning:
        return None


def _from_flags(kind: "type[BridgeTable]", args: Namespace, flags: dict[str, Any]) -> "BridgeTable":
    """Make a table from the options. argparse has checked their types; the table checks ranges."""
    from msgspec import structs

    from bus.process.tables import checked
    from bus_bridge.config import check_values

    flags |= {"id": args.id, "namespace": args.namespace, "allow": args.allow, "deny": args.deny}
    kinds = {field.name: field.type for field in structs.fields(kind)}
    table = kind(
        **{key: checked(option(key), value, kinds[key]) for key, value in flags.items() if value is not None}
    )
    check_values(table, option)
    return table
