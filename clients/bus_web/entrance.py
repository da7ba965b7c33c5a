"""The way into a server: the gate, and the addresses that lead through it."""

import secrets
from collections.abc import Iterable
from typing import NamedTuple

from bus_web.gate import Gate
from bus_web.place import Place

__all__ = ["Addresses", "open_gate"]


class Addresses(NamedTuple):
    """Where a server is to be had, with the token of this start."""

    page: str
    once: str
    """The page, by a ticket that is good for whoever comes first: all users read what a command line says."""
    forwarding: str
    """What to say where the browser is, before any of these leads anywhere; empty where nothing is needed."""

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
