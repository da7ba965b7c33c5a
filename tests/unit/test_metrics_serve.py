"""bus_cli.metrics.serve: what is answered, and that nobody can hold it up."""

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_cli.metrics import serve as module
from bus_cli.metrics.place import Listening, Place
from bus_cli.metrics.serve import MOST_CONNECTIONS, respond, serve

HOSTS = frozenset({"localhost", "127.0.0.1"})
GET = "GET /metrics HTTP/1.1\r\nHost: localhost:9464\r\n\r\n"


def page(accept: str) -> tuple[bytes, str]:
    return f"for {accept}".encode(), "text/plain"


def status(request: str, hosts: frozenset[str] = HOSTS) -> int:
    return int(respond(request, hosts, page).status.split()[0])


def test_the_page() -> None:
    request = "GET /metrics?x=1 HTTP/1.0\r\naccept: application/openmetrics-text\r\n\r\n"
    assert respond(request, HOSTS, page).body == b"for application/openmetrics-text"


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (GET, 200),
        (GET.replace("GET", "HEAD"), 200),
        (GET.replace("GET", "POST"), 405),
        (GET.replace("GET", "DELETE"), 405),
        (GET.replace("/metrics", "/"), 404),
        (GET.replace("/metrics", "/metrics/../etc"), 404),
        (GET.replace("/metrics", "http://localhost/metrics"), 404),
        (GET.replace("HTTP/1.1", "HTTP/2"), 400),
        (GET.replace(" /metrics", ""), 400),
        ("", 400),
        ("\r\n\r\n", 400),
        ("GET /metrics HTTP/1.1\r\n", 400),
        ("\x16\x03\x01\x02\r\n\r\n", 400),
        ("GET /metrics HTTP/1.1\r\n" + "x" * 20_000, 431),
    ],
)
def test_answers(request_: str, expected: int) -> None:
    assert status(request_) == expected


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("localhost", 200),
        ("LOCALHOST:80", 200),
        ("127.0.0.1:9464", 200),
        ("evil.example", 403),
        ("localhost.evil.example:9464", 403),
        ("127.0.0.2", 403),
        (":9464", 403),
    ],
)
def test_only_by_our_own_names(host: str, expected: int) -> None:
    """A page in a browser may reach loopback by a name that its owner points there."""
    request = GET.replace("localhost:9464", host)
    assert status(request) == expected
    assert status(request, frozenset()) == 200  # by a UNIX socket, which no browser can open


def test_without_a_host() -> None:
    assert status("GET /metrics HTTP/1.0\r\n\r\n") == 200


_PIECES = st.sampled_from(
    [
        "GET",
        "HEAD",
        " ",
        "/metrics",
        "HTTP/1.1",
        "\r\n",
        "\r\n\r\n",
        "Host",
        ":",
        "localhost",
        "Accept",
        "\0",
        "\xff",
    ]
)


@given(st.lists(_PIECES | st.text(st.characters(max_codepoint=255), max_size=5), max_size=12).map("".join))
def test_any_bytes_have_an_answer(request: str) -> None:
    answer = respond(request, HOSTS, page)
    assert answer.encode().startswith(b"HTTP/1.1 ")
    if answer.status.startswith("200"):
        assert request.startswith(("GET /metrics", "HEAD /metrics"))


@asynccontextmanager
async def serving(path: Path) -> AsyncIterator[None]:
    with Listening(Place(path=path)) as listening:
        task = asyncio.create_task(serve(listening.socket, listening.hosts, page))
        try:
            yield
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


async def ask(path: Path, request: bytes) -> bytes:
    reader, writer = await asyncio.open_unix_connection(path)
    try:
        writer.write(request)
        return await reader.read()
    except ConnectionError:
        return b""
    finally:
        writer.close()
        with suppress(ConnectionError):
            await writer.wait_closed()


async def test_over_a_socket(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    async with serving(path):
        answer = await ask(path, GET.encode())
        assert answer.startswith(b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\nContent-Length: 4\r\n")
        assert answer.endswith(b"Connection: close\r\n\r\nfor ")
        head = await ask(path, GET.replace("GET", "HEAD").encode())
        assert head.endswith(b"Connection: close\r\n\r\n")
        assert b"Content-Length: 4" in head
        assert b"Allow: GET, HEAD\r\n" in await ask(path, GET.replace("GET", "PUT").encode())


async def test_a_request_in_pieces(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    async with serving(path):
        reader, writer = await asyncio.open_unix_connection(path)
        for byte in GET.encode():
            writer.write(bytes([byte]))
            await writer.drain()
        assert (await reader.read()).startswith(b"HTTP/1.1 200")
        writer.close()
        await writer.wait_closed()


async def test_too_much_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    async with serving(path):
        answer = await ask(path, b"GET /metrics HTTP/1.1\r\n" + b"x: y\r\n" * 20_000)
        assert answer.startswith(b"HTTP/1.1 431 ")


async def test_who_hangs_up_is_forgotten(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    async with serving(path):
        for _ in range(3 * MOST_CONNECTIONS):
            _, writer = await asyncio.open_unix_connection(path)
            writer.write(b"GET /met")
            writer.close()
            await writer.wait_closed()
        assert (await ask(path, GET.encode())).startswith(b"HTTP/1.1 200")


async def test_those_that_say_nothing_are_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As many as there is room for: who waits behind them is served in the end."""
    monkeypatch.setattr(module, "_EXCHANGE_S", 0.05)
    path = tmp_path / "m.sock"
    async with serving(path):
        silent = [await asyncio.open_unix_connection(path) for _ in range(MOST_CONNECTIONS)]
        while not (await ask(path, GET.encode())).startswith(b"HTTP/1.1 200"):
            pass  # cut off itself, by a machine that is so slow
        for reader, writer in silent:
            assert await reader.read() == b""
            writer.close()
            await writer.wait_closed()


async def test_it_ends_with_somebody_connected(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    async with serving(path):
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(b"GET")
        assert (await ask(path, GET.encode())).startswith(b"HTTP/1.1 200")
    with suppress(ConnectionError):  # where its last bytes were not read
        assert await reader.read() == b""
    writer.close()
    with suppress(ConnectionError):
        await writer.wait_closed()
    assert not path.exists()


async def test_a_machine_without_descriptors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, failures = tmp_path / "m.sock", [OSError(24, "Too many open files")] * 3
    real = module._accept

    async def accept(listening: socket.socket) -> socket.socket:
        if failures:
            raise failures.pop()
        return await real(listening)

    monkeypatch.setattr(module, "_RETRY_S", 0.001)
    monkeypatch.setattr(module, "_accept", accept)
    async with serving(path):
        assert (await ask(path, GET.encode())).startswith(b"HTTP/1.1 200")
    assert not failures
