"""prometheus-client's page and server on loopback, for those that ask by a name of this machine.

A page in a browser may reach loopback too, by a name that its owner points there.
"""

import errno
import re
import socket
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any
from wsgiref.simple_server import WSGIRequestHandler, make_server

from prometheus_client.exposition import ThreadingWSGIServer, make_wsgi_app
from prometheus_client.registry import CollectorRegistry

from bus_cli.output import CommandError
from bus_web.place import Place

if TYPE_CHECKING:
    from _typeshed.wsgi import StartResponse, WSGIApplication, WSGIEnvironment

__all__ = ["Server", "open_server"]

_SILENCE_S = 10.0
_PORT = re.compile(r":[0-9]*$")


class Server(ThreadingWSGIServer):
    """A thread for each request."""

    place: Place
    """Where it listens."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up or says nothing is no news."""


class _ServerOf6(Server):
    address_family = socket.AF_INET6


class _Handler(WSGIRequestHandler):
    timeout = _SILENCE_S  # after which a connection is closed

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are no news either."""


def open_server(place: Place, registry: CollectorRegistry) -> Server:
    """Listen at `place`; `serve_forever` answers. Raises CommandError where the place can't be had."""
    kind = _ServerOf6 if ":" in place.address else Server
    app = asked_by(frozenset({"localhost", place.host}), make_wsgi_app(registry))
    try:
        server = make_server(place.address, place.port, app, kind, _Handler)
    except OSError as error:
        other = "; choose another port with --listen" if error.errno == errno.EADDRINUSE else ""
        raise CommandError(f"can't listen on {place}: {error.strerror}{other}") from None
    server.place = Place(place.address, server.server_port)
    return server


def asked_by(hosts: frozenset[str], app: "WSGIApplication") -> "WSGIApplication":
    """The application, for requests whose header Host is missing or one of `hosts`, with any port."""

    def answer(request: "WSGIEnvironment", start_response: "StartResponse") -> Iterable[bytes]:
        host = request.get("HTTP_HOST", "").lower()
        if host and _PORT.sub("", host) not in hosts:
            start_response("403 Forbidden", [("Content-Type", "text/plain; charset=utf-8")])
            return [b"ask for an address of this machine, or localhost\n"]
        return app(request, start_response)

    return answer
