"""`bus bridge zenoh`: connects the buses of several machines through zenoh."""

from argparse import ArgumentParser, Namespace

from bus.base.optional import how_to_install
from bus_cli.bridge.bridgeargs import add_bridge_arguments, add_certificate_arguments, run_bridge, tls_of

_EPILOG = f"""\
ADDRESS is tls/HOST:PORT, quic/HOST:PORT or tcp/HOST:PORT. One that other machines can reach needs tls/ or
quic/ with certificates on both sides, or --insecure.
Needs eclipse-zenoh: {how_to_install("eclipse-zenoh")}
See docs/bridge.md
"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = _EPILOG
    group = parser.add_argument_group("links")
    group.add_argument(
        "--listen",
        action="append",
        metavar="ADDRESS",
        help="wait for other bridges; may be given several times",
    )
    group.add_argument(
        "--connect",
        action="append",
        metavar="ADDRESS",
        help="connect to another bridge, and retry until it answers; may be given several times",
    )
    group.add_argument(
        "--router",
        action="append",
        metavar="ADDRESS",
        help="use a router of zenoh (zenohd) instead of --listen and --connect; of several, one is used",
    )
    add_certificate_arguments(group)
    group.add_argument(
        "--compression",
        action="store_true",
        default=None,
        help="compress what is sent on links whose other side has this option, too; it costs CPU time",
    )
    group = parser.add_argument_group("fleets")
    group.add_argument("--group", metavar="NAME", help="the group of this bus, for the --see of others")
    group.add_argument(
        "--see",
        action="append",
        metavar="GROUP",
        help="see only buses of this group (default: all); two buses must see each other's group; may be "
        "given several times",
    )
    add_bridge_arguments(parser, "zenoh")


def main(args: Namespace) -> int:
    """Run the bridge until Ctrl-C."""
    flags = {
        "listen": args.listen,
        "connect": args.connect,
        "router": args.router,
        "insecure": args.insecure,
        "compression": args.compression,
        "group": args.group,
        "see": args.see,
        "tls": tls_of(args),
    }
    return run_bridge(args, "zenoh", flags)
