"""prometheus-client's page and server on loopback. It only answers requests for a name of this machine.

Reason: a web page in a browser can reach loopback, too, if its owner lets a name point there.
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
    """HTTP server with a thread for each request."""

    place: Place
    """Address on which it listens."""

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing: a client that hangs up or stays silent is not an error."""


class _ServerOf6(Server):
    address_family = socket.AF_INET6


class _Handler(WSGIRequestHandler):
    timeout = _SILENCE_S  # closes silent connections

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing about requests."""


def open_server(place: Place, registry: CollectorRegistry) -> Server:
    """Listen at `place`; `serve_forever` answers. Raises CommandError if it can't listen there."""
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
    """The application, limited to requests without a Host header, or with one of `hosts` and any port."""

    def answer(request: "WSGIEnvironment", start_response: "StartResponse") -> Iterable[bytes]:
        host = request.get("HTTP_HOST", "").lower()
        if host and _PORT.sub("", host) not in hosts:
            start_response("403 Forbidden", [("Content-Type", "text/plain; charset=utf-8")])
            return [b"ask for an address of this machine, or localhost\n"]
        return app(request, start_response)

    return answer
