"""`bus web`, once its command line is understood: the server and the bus brought together."""

import asyncio
import os
import secrets
from collections.abc import Callable, Sequence
from contextlib import aclosing

import msgspec

from bus.node import Node
from bus_web import page_protocol
from bus_web.files import load
from bus_web.gate import Gate
from bus_web.hub import Hub
from bus_web.place import Place
from bus_web.server import Server
from bus_web.viewer import Viewer

__all__ = ["Addresses", "Options", "run"]


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
    server = Server(
        gate,
        load(),
        {page_protocol.SUBPROTOCOL: lambda socket: Viewer(hub, socket, bus).run()},
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
