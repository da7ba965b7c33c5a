"""`bus web`: a page with the graph, rates, values and plots. Its small server also serves Foxglove."""

import os
import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from typing import TYPE_CHECKING

from bus.base.optional import how_to_install
from bus.process.address import socket_path
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.stream import open_node, run_stream
from bus_web.place import DEFAULT, parse_place

if TYPE_CHECKING:
    from bus_web.entrance import Addresses

_EPILOG = f"""\
Served only on loopback or a unix socket, and only to clients with the token in the printed address. Clients
can't publish, call services or set parameters without the options that allow it. See docs/look.md.
Needs websockets: {how_to_install("websockets")}
"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = _EPILOG
    parser.add_argument(
        "--listen",
        metavar="PLACE",
        type=parse_place,
        default=DEFAULT,
        help=f"address:port (port 0 for any) or unix:PATH (default: {DEFAULT})",
    )
    parser.add_argument("--open", action="store_true", help="open the page in a browser")
    parser.add_argument(
        "--allow-origin",
        metavar="ORIGIN",
        action="append",
        type=_origin,
        default=[],
        help="origin of a page that may also connect, as http://localhost:8080; can be repeated",
    )
    parser.add_argument("--allow-publish", action="store_true", help="let Foxglove publish messages")
    parser.add_argument("--allow-call", action="store_true", help="let Foxglove call services")
    parser.add_argument("--allow-set", action="store_true", help="let Foxglove set parameters")


def main(args: Namespace) -> int:
    """Serve until a signal."""
    if args.open and args.listen.path is not None:
        raise CommandError("--open needs an address:port: a browser opens no unix socket")
    try:
        import websockets  # noqa: F401
    except ImportError as error:
        raise CommandError(f"the page needs websockets ({error}): {how_to_install('websockets')}") from None
    from bus_web.listening import ListenError

    try:
        return run_stream(_serve(args))
    except ListenError as error:
        raise CommandError(error) from None


async def _serve(args: Namespace) -> int:
    from bus_web.browser import open_browser
    from bus_web.foxglove.session import Permissions
    from bus_web.program import Options, run

    may = Permissions(publish=args.allow_publish, call=args.allow_call, set=args.allow_set)
    options = Options(listen=args.listen, origins=args.allow_origin, may=may)

    def ready(addresses: "Addresses") -> None:
        _print_addresses(addresses, as_json=args.json)
        if args.open:
            open_browser(addresses.once, complain)

    async with open_node(args, f"_bus_web_{os.getpid()}") as node:
        await run(node, options, str(socket_path(args.socket, args.domain)), ready)
    return 0


def _print_addresses(addresses: "Addresses", *, as_json: bool) -> None:
    page, foxglove, forwarding = addresses.page, addresses.websocket, addresses.forwarding
    if as_json:
        print_json({"page": page, "foxglove": foxglove, "forwarding": forwarding})
        return
    if forwarding:
        say(f"first: {forwarding}")
    say(f"page: {page}")
    say(f"foxglove: {foxglove}")


def _origin(text: str) -> str:
    """Read the origin of a web page, for argparse."""
    if not re.fullmatch(r"https?://([\w.-]+|\[[\da-f:]+\])(:\d{1,5})?/?", text, re.ASCII | re.IGNORECASE):
        raise ArgumentTypeError(f"{text!r} is not an origin, such as https://studio.example.org")
    return text
