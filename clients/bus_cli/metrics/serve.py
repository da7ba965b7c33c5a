"""A small HTTP server for one page, in asyncio: who is slow, or sends too much, hurts nobody.

Owns requests and answers. Must not know what stands in the page.
"""

import asyncio
import re
import socket
from collections.abc import Callable
from typing import NamedTuple

__all__ = ["MOST_CONNECTIONS", "Answer", "Page", "serve"]

MOST_CONNECTIONS = 8
"""At a time."""

_EXCHANGE_S = 10.0
_LINGER_S = 1.0
_RETRY_S = 0.1
_LONGEST_REQUEST = 16_384
_PATH = "/metrics"
_PORT = re.compile(r":[0-9]*$")
_PLAIN = "text/plain; charset=utf-8"

Page = Callable[[str], tuple[bytes, str]]
"""From the header Accept to the page and its content type."""


class Answer(NamedTuple):
    """To one request."""

    status: str
    body: bytes
    content_type: str = _PLAIN
    header: str = ""

    def encode(self, *, with_body: bool = True) -> bytes:
        head = (
            f"HTTP/1.1 {self.status}\r\nContent-Type: {self.content_type}\r\n"
            f"Content-Length: {len(self.body)}\r\n{self.header}Connection: close\r\n\r\n"
        )
        return head.encode("latin-1") + (self.body if with_body else b"")


async def serve(listening: socket.socket, hosts: frozenset[str], page: Page) -> int:
    """Answer until it is cancelled. `hosts`: what the header Host may say; empty: anything."""
    listening.setblocking(False)
    room = asyncio.Semaphore(MOST_CONNECTIONS)
    async with asyncio.TaskGroup() as group:
        while True:
            await room.acquire()  # who comes meanwhile waits in the kernel's queue
            try:
                sock = await _accept(listening)
            except OSError:  # out of descriptors, or who called has gone
                room.release()
                await asyncio.sleep(_RETRY_S)
                continue
            task = group.create_task(_attend(sock, hosts, page))
            task.add_done_callback(lambda _: room.release())


async def _accept(listening: socket.socket) -> socket.socket:
    sock, _ = await asyncio.get_running_loop().sock_accept(listening)
    return sock


async def _attend(sock: socket.socket, hosts: frozenset[str], page: Page) -> None:
    """One connection, one request. Who does not keep the time is cut off."""
    loop = asyncio.get_running_loop()
    with sock:
        try:
            async with asyncio.timeout(_EXCHANGE_S):
                request = await _read(sock)
                answer = respond(request, hosts, page)
                await loop.sock_sendall(sock, answer.encode(with_body=not request.startswith("HEAD ")))
            sock.shutdown(socket.SHUT_WR)
            # To close with something unread would take the answer away from who has not read it yet.
            async with asyncio.timeout(_LINGER_S):
                while await loop.sock_recv(sock, _LONGEST_REQUEST):
                    pass
        except (TimeoutError, OSError):
            pass


async def _read(sock: socket.socket) -> str:
    """The head of a request; as much as came where it is too long, or ends early."""
    loop, head = asyncio.get_running_loop(), b""
    while b"\r\n\r\n" not in head and len(head) < _LONGEST_REQUEST:
        part = await loop.sock_recv(sock, _LONGEST_REQUEST - len(head))
        if not part:
            break
        head += part
    return head.decode("latin-1")


def respond(request: str, hosts: frozenset[str], page: Page) -> Answer:
    """The answer to the head of a request."""
    head, end, _ = request.partition("\r\n\r\n")
    if not end and len(request) >= _LONGEST_REQUEST:
        return Answer("431 Request Header Fields Too Large", b"the request is too long\n")
    line, *lines = head.split("\r\n")
    words = line.split(" ")
    if not end or len(words) != 3 or not words[2].startswith("HTTP/1."):
        return Answer("400 Bad Request", b"this is no HTTP/1 request\n")
    headers = {
        name.strip().lower(): value.strip() for name, _, value in (one.partition(":") for one in lines)
    }
    host = headers.get("host", "").lower()
    if hosts and host and _PORT.sub("", host) not in hosts:
        return Answer("403 Forbidden", b"ask for an address of this machine, or localhost\n")
    if words[1].partition("?")[0] != _PATH:
        return Answer("404 Not Found", f"there is only {_PATH}\n".encode())
    if words[0] not in ("GET", "HEAD"):
        return Answer("405 Method Not Allowed", b"GET or HEAD\n", header="Allow: GET, HEAD\r\n")
    body, content_type = page(headers.get("accept", ""))
    return Answer("200 OK", body, content_type)
