"""`bus web`: a page with the graph, rates, values and plots. Its small server also serves Foxglove."""

import os
import re
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from contextlib import AsyncExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from bus.base.optional import how_to_install
from bus.process.address import socket_path
from bus_cli.output import CommandError, complain, print_json, say
from bus_cli.stream import open_node, run_stream
from bus_web.place import DEFAULT, parse_place

if TYPE_CHECKING:
    from bus_web.entrance import Addresses
    from bus_web.playback import Playback
    from bus_web.program import Options

_CLOCK_HZ = 40.0
_LOOK_BACK_NS = 2_000_000_000
"""A seek shows the messages of the last two seconds, also in a pause."""
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
    parser.add_argument(
        "--bag",
        metavar="BAG",
        action="append",
        type=Path,
        default=[],
        help="also play this bag, under control of the page, on a bus of its own (with --socket or --domain: "
        "on that bus); can be repeated",
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
        return run_stream(_play(args) if args.bag else _serve(args))
    except ListenError as error:
        raise CommandError(error) from None


async def _serve(args: Namespace, playback: "Playback | None" = None) -> int:
    from bus_web.browser import open_browser
    from bus_web.program import run

    path = socket_path(args.socket, args.domain)

    def ready(addresses: "Addresses") -> None:
        bag = None if playback is None else playback.recording.name
        _print_addresses(addresses, bag, str(path), as_json=args.json)
        if args.open:
            open_browser(addresses.once, complain)

    async with open_node(args, f"_bus_web_{os.getpid()}") as node:
        await run(node, _options(args), str(path), ready, playback)
    return 0


async def _play(args: Namespace) -> int:
    """Serve while a bag is played."""
    from bus_bag.page import play_on_page, recording_of
    from bus_bag.play.options import PlayOptions
    from bus_bag.play.selection import Selection
    from bus_bag.storage import open_bags
    from bus_bag.terminal.keyboard import Keyboard
    from bus_cli.own_bus import own_bus

    async def serve(playback: "Playback") -> None:
        await _serve(args, playback)

    options = PlayOptions(
        selection=Selection(),
        is_paused=True,
        stays_at_end=True,
        look_back=_LOOK_BACK_NS,
        clock_hz=_CLOCK_HZ,
        has_keys=Keyboard.is_there(),
    )
    with open_bags(args.bag) as bags:
        recording = recording_of(bags, args.bag)
        async with AsyncExitStack() as stack:
            if args.socket is None and args.domain is None:
                args.socket = str(await stack.enter_async_context(own_bus()))
            await play_on_page(bags, recording, options, serve, socket=args.socket, domain=args.domain)
    return 0


def _options(args: Namespace) -> "Options":
    from bus_web.foxglove.session import Permissions
    from bus_web.program import Options

    may = Permissions(publish=args.allow_publish, call=args.allow_call, set=args.allow_set)
    return Options(listen=args.listen, origins=args.allow_origin, may=may)


def _print_addresses(addresses: "Addresses", bag: str | None, path: str, *, as_json: bool) -> None:
    page, foxglove, forwarding = addresses.page, addresses.websocket, addresses.forwarding
    if as_json:
        played = {} if bag is None else {"bag": bag, "socket": path}
        print_json({"page": page, "foxglove": foxglove, "forwarding": forwarding, **played})
        return
    if forwarding:
        say(f"first: {forwarding}")
    say(f"page: {page}")
    say(f"foxglove: {foxglove}")
    if bag is not None:
        say(f"bag: {bag}, on the bus of: export BUSD_SOCKET={path}")


def _origin(text: str) -> str:
    """Read the origin of a web page, for argparse."""
    if not re.fullmatch(r"https?://([\w.-]+|\[[\da-f:]+\])(:\d{1,5})?/?", text, re.ASCII | re.IGNORECASE):
        raise ArgumentTypeError(f"{text!r} is not an origin, such as https://studio.example.org")
    return text
