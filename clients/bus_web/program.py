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
from bus_web.entrance import Addresses, open_gate
from bus_web.files import load
from bus_web.foxglove.formats import Formats
from bus_web.foxglove.protocol import SDK, SUBPROTOCOLS
from bus_web.foxglove.session import Permissions, Session
from bus_web.hub import Hub
from bus_web.listening import listening
from bus_web.page_session import PageSession
from bus_web.place import Place
from bus_web.playback import Playback
from bus_web.server import Server

__all__ = ["Options", "run"]

_MOST_FRAME_BYTES = 1 << 20
"""A client may subscribe to thousands of topics in one frame."""
_MOST_DATA_BYTES = 16 << 20
"""Limit for a client that may publish or call."""


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """Options of the command line."""

    listen: Place
    origins: Sequence[str] = ()
    may: Permissions = Permissions()


async def run(
    node: Node,
    options: Options,
    bus: str,
    ready: Callable[[Addresses], None],
    playback: Playback | None = None,
) -> None:
    """Serve until cancelled. `bus` is the page's name for the bus; `ready` is called with the addresses.
    Clients control the `playback`, if there is one.

    Raises ListenError if the server can't listen at the place.
    """
    hub = Hub(node, os.getpid())
    formats, session_id = Formats(node), secrets.token_hex(8)
    may = options.may

    async def speak_foxglove(socket: ServerConnection) -> None:
        played = playback if socket.subprotocol == SDK else None  # the older one has no frames for it
        await Session(hub, formats, socket, bus, session_id, may, played).run()

    with listening(options.listen) as (listener, place):
        gate, addresses = open_gate(place, options.origins)
        server = Server(
            gate,
            load(),
            {
                page_protocol.SUBPROTOCOL: lambda socket: PageSession(hub, socket, bus, playback).run(),
                **dict.fromkeys(SUBPROTOCOLS, speak_foxglove),
            },
            most_frame_bytes=_MOST_DATA_BYTES if may.publish or may.call else _MOST_FRAME_BYTES,
        )
        async with aclosing(hub):
            try:
                await server.open(listener)
                ready(addresses)
                await asyncio.get_running_loop().create_future()
            finally:
                await server.close()
