"""`bus web`, once its command line is understood: the server and the bus brought together."""

import asyncio
import os
import secrets
from collections.abc import Callable, Sequence
from contextlib import aclosing

import msgspec
from websockets.asyncio.server import ServerConnection

from bus.node import Node
from bus_web import page_protocol
from bus_web.files import load
from bus_web.foxglove.formats import Formats
from bus_web.foxglove.protocol import SUBPROTOCOLS
from bus_web.foxglove.session import Permissions, Session
from bus_web.gate import Gate
from bus_web.hub import Hub
from bus_web.place import Place
from bus_web.server import Server
from bus_web.viewer import Viewer

__all__ = ["Addresses", "Options", "run"]

_MOST_FRAME_BYTES = 1 << 20
"""A client may subscribe to thousands of topics in one frame."""
_MOST_DATA_BYTES = 16 << 20
"""Of one who may publish or call."""


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """What the command line says. Without the last three, who comes may look and do nothing else."""

    listen: Place
    origins: Sequence[str] = ()
    opens: bool = False
    """Whether a browser will be started, with an address on its command line."""
    may_publish: bool = False
    may_call: bool = False
    may_set: bool = False


class Addresses(msgspec.Struct, frozen=True):
    """Where the server is to be had, with the token; `forwarding` where a browser needs that first."""

    page: str
    foxglove: str
    forwarding: str = ""
    once: str = ""
    """The page by a token that is good for the first who comes with it."""


async def run(node: Node, options: Options, bus: str, ready: Callable[[Addresses], None]) -> None:
    """Serve until cancelled. `bus` is what the page calls the bus; `ready` is told the addresses.

    Raises PlaceError where the place can't be had.
    """
    token = secrets.token_urlsafe(24)
    hub = Hub(node, os.getpid())
    place = options.listen
    ticket = secrets.token_urlsafe(24)
    gate = Gate(token, place.cookie, options.origins)
    if options.opens:
        gate.issue(ticket)
    formats, session_id = Formats(node), secrets.token_hex(8)
    may = Permissions(publish=options.may_publish, call=options.may_call, set=options.may_set)

    async def speak_foxglove(socket: ServerConnection) -> None:
        await Session(hub, formats, socket, bus, session_id, may).run()

    server = Server(
        gate,
        load(),
        {
            page_protocol.SUBPROTOCOL: lambda socket: Viewer(hub, socket, bus).run(),
            **dict.fromkeys(SUBPROTOCOLS, speak_foxglove),
        },
        most_frame_bytes=_MOST_DATA_BYTES if may.publish or may.call else _MOST_FRAME_BYTES,
    )
    async with aclosing(hub):
        try:
            place = await server.open(place)
            ready(_addresses(place, token, ticket if options.opens else ""))
            await asyncio.get_running_loop().create_future()
        finally:
            await server.close()


def _addresses(place: Place, token: str, ticket: str) -> Addresses:
    where = f"{place.authority}/?token="
    return Addresses(
        page=f"http://{where}{token}",
        foxglove=f"ws://{where}{token}",
        forwarding=place.forwarding if place.path is not None else "",
        once=f"http://{where}{ticket}" if ticket else "",
    )
