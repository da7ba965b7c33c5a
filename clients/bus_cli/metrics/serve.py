"""prometheus-client's page and server on loopback. It only answers requests for a name of this machine.

Reason: a web page in a browser can reach loopback, too, if its owner lets a name point there.
"""

import errno
import re
import socket
import threading
from collections.abc import Iterable
from contextlib import suppress
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
_MOST_CONNECTIONS = 64
_PORT = re.compile(r":[0-9]*$")


class Server(ThreadingWSGIServer):
    """HTTP server with a thread for each request.

    It has a limit of connections, because any user of the machine may connect. Above it, the oldest one ends.
    """

    place: Place
    """Address on which it listens."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._lock = threading.Lock()
        self._connections: dict[Any, None] = {}
        """The oldest first."""
        super().__init__(*args, **kwargs)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            self._connections[request] = None
            surplus = list(self._connections)[:-_MOST_CONNECTIONS]
            for oldest in surplus:
                del self._connections[oldest]
                with suppress(OSError):
                    oldest.shutdown(socket.SHUT_RDWR)  # its thread reads the end, and closes it
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._connections.pop(request, None)
        super().shutdown_request(request)

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
