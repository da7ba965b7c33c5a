"""`bus bridge zenoh`: connects the buses of several machines through zenoh."""

from argparse import ArgumentParser, Namespace

from bus.base.optional import how_to_install
from bus_cli.bridge.bridgeargs import add_bridge_arguments, run_bridge

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
    add_bridge_arguments(parser, "zenoh")


def main(args: Namespace) -> int:
    """Run the bridge until Ctrl-C."""
    tls = {name: value for name in ("ca", "certificate", "key") if (value := getattr(args, name))}
    flags = {
        "listen": args.listen,
        "connect": args.connect,
        "router": args.router,
        "insecure": args.insecure,
        "tls": tls or None,
    }
    return run_bridge(args, "zenoh", flags)
