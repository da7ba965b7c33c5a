"""The way into a server: the gate, and the addresses that lead through it."""

import secrets
from collections.abc import Iterable
from typing import NamedTuple

from bus_web.gate import Gate
from bus_web.place import Place

__all__ = ["Addresses", "open_gate"]


class Addresses(NamedTuple):
    """Addresses of a server, with the token of this start."""

    page: str
    once: str
    """The page, by a ticket that works once, for the first request: all users can read command lines."""
    forwarding: str
    """The command to run on the browser's machine before these addresses work; empty if none is needed."""

    @property
    def websocket(self) -> str:
        """For programs that speak one of the subprotocols."""
        return self.page.replace("http:", "ws:", 1)


def open_gate(place: Place, origins: Iterable[str] = ()) -> tuple[Gate, Addresses]:
    """For a server that listens at `place`; pages of `origins` may connect besides its own."""
    token, ticket = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
    gate = Gate(token, place.cookie, origins)
    gate.issue(ticket)
    where = f"http://{place.authority}/?token="
    return gate, Addresses(
        f"{where}{token}", f"{where}{ticket}", place.forwarding if place.path is not None else ""
    )
