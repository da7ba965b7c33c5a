"""HTTP and WebSockets on one socket: files by GET, and subprotocols by their handlers."""

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable, Mapping
from http import HTTPStatus

from websockets.asyncio.server import Server as WebSocketServer
from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, NegotiationError
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from bus_web.connections import Connections
from bus_web.files import File, security_headers
from bus_web.gate import Ask, Enter, Gate, Redirect, Refuse
from bus_web.page_protocol import Mistake

__all__ = ["Handler", "Server"]

Handler = Callable[[ServerConnection], Awaitable[None]]
"""Speaks one subprotocol on a connection until that ends. Raises Mistake for an invalid request."""

_MOST_CLIENTS = 16
_MOST_FRAME_BYTES = 64 << 10
"""Most bytes that a client may send in one frame; more if it may publish."""
_OPEN_S, _CLOSE_S, _PING_S = 5.0, 1.0, 20.0
_POLICY_VIOLATION, _INTERNAL_ERROR = 1008, 1011


class Server:
    """`files` by their paths, `handlers` by their subprotocols; each request must pass the `gate`."""

    def __init__(
        self,
        gate: Gate,
        files: Mapping[str, File],
        handlers: Mapping[str, Handler],
        *,
        most_frame_bytes: int = _MOST_FRAME_BYTES,
    ) -> None:
        self._gate = gate
        self._files = files
        self._handlers = handlers
        self._most_frame_bytes = most_frame_bytes
        self._server: WebSocketServer | None = None
        self._clients = 0
        self._connections = Connections()

    async def open(self, listening: socket.socket) -> None:
        """Answer clients that connect to `listening`, until `close`, which closes that too."""
        self._server = await serve(
            self._serve,
            sock=listening,
            subprotocols=[Subprotocol(name) for name in self._handlers],
            select_subprotocol=self._choose,
            process_request=self._answer,
            create_connection=self._connections.connection_class(),
            server_header=None,
            compression=None,
            max_size=self._most_frame_bytes,
            open_timeout=_OPEN_S,
            close_timeout=_CLOSE_S,
            ping_interval=_PING_S,
            ping_timeout=_PING_S,
            logger=_silent(),
        )

    async def close(self) -> None:
        """End all connections: clients learn that the server ends."""
        if self._server is not None:
            self._connections.cut_off_those_who_ask()
            self._server.close()
            await self._server.wait_closed()

    async def _serve(self, connection: ServerConnection) -> None:
        if self._clients >= _MOST_CLIENTS:
            await connection.close(_POLICY_VIOLATION, f"{_MOST_CLIENTS} clients are connected")
            return
        self._clients += 1
        try:
            await self._handlers[connection.subprotocol or ""](connection)
        except ConnectionClosed:
            pass
        except Mistake as mistake:
            await connection.close(_POLICY_VIOLATION, str(mistake)[:120])
        except Exception as error:  # websockets would say nothing of it
            context = {"message": "bus web failed for one client", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)
            await connection.close(_INTERNAL_ERROR)
        finally:
            self._clients -= 1

    def _choose(self, connection: ServerConnection, offered: object) -> Subprotocol:
        for name in self._handlers:
            if name in (offered or ()):  # type: ignore[operator]
                return Subprotocol(name)
        raise NegotiationError(f"subprotocols here: {', '.join(self._handlers)}")

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """None lets it through to its handler."""
        headers = request.headers
        is_socket = "websocket" in ",".join(headers.get_all("Upgrade")).lower()
        ask = Ask(
            target=request.path,
            method=getattr(request, "method", "GET"),  # before websockets 16 there was no other
            host=headers.get_all("Host"),
            origin=headers.get_all("Origin"),
            cookie=headers.get_all("Cookie"),
        )
        decision = self._gate.judge(ask, is_socket=is_socket)
        if isinstance(decision, Enter):
            self._connections.let_in(connection)
        match decision:
            case Refuse(status, text):
                return _response(status, "localhost", File("text/plain; charset=utf-8", f"{text}\n".encode()))
            case Redirect(location, cookie):
                return _response(303, "localhost", None, {"Location": location, "Set-Cookie": cookie})
            case Enter(path, host) if not is_socket:
                file = self._files.get(path)
                if file is None:
                    nothing = File("text/plain; charset=utf-8", b"there is nothing here\n")
                    return _response(404, host, nothing)
                return _response(200, host, file)
        return None


def _response(status: int, host: str, file: File | None, more: Mapping[str, str] | None = None) -> Response:
    body = file.body if file is not None else b""
    headers = {
        **security_headers(host),
        **(more or {}),
        "Content-Length": str(len(body)),
        "Connection": "close",
    }
    if file is not None:
        headers["Content-Type"] = file.content_type
    return Response(status, HTTPStatus(status).phrase, Headers(headers), body)


def _silent() -> logging.Logger:
    """Clients that hang up in the middle of something are no news."""
    logger = logging.getLogger("bus_web.websockets")
    logger.propagate = False
    logger.disabled = True
    return logger
