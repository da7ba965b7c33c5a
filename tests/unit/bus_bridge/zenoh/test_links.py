"""Addresses that are not up. The user gets each message once, and only if it is true."""

import asyncio
import socket

import pytest

pytest.importorskip("zenoh", reason="needs the extra zenoh: make setup installs it")

from bus_bridge.zenoh import links as links_module
from bus_bridge.zenoh.links import Links
from bus_bridge.zenoh.options import ZenohOptions
from bus_bridge.zenoh.session import Link


class Session:
    """A session with the links that a test sets."""

    def __init__(self) -> None:
        self.up: list[Link] = []

    def links(self) -> list[Link]:
        return self.up

    def routers(self) -> set[str]:
        return set()


async def test_who_comes_back_after_a_long_time_is_not_said_to_be_no_bridge() -> None:
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        port = place.getsockname()[1]
        session, said = Session(), list[str]()
        where = f"tcp/127.0.0.1:{port}"
        links = Links(ZenohOptions(connect=(where,)), session, said.append)  # type: ignore[arg-type]

        async def look() -> list[str]:
            for _ in range(3):
                await links.check()
            new, said[:] = list(said), []
            return new

        refused = f"--connect {where}: connection refused; still trying"
        assert [await look() for _ in range(3)] == [[refused]] * 3
        place.listen()
        assert await look() == []  # zenoh has a moment to make a link
        other = (
            f"--connect {where}: a program listens there, but not a bridge of busd that accepts this one; "
            "still trying"
        )
        assert await look() == [other]
        assert [one.text for one in links.status([])] == [
            "a program listens there, but not a bridge of busd that accepts this one"
        ]
        session.up = [Link("f00", "tcp/127.0.0.1:1", where)]
        assert await look() == []
        assert [(one.state, one.text) for one in links.status([])] == [("up", "")]
        session.up = []
        assert await look() == []
        assert await look() == [other]


async def test_an_address_that_refuses_is_not_up_by_a_link_with_another_port_there() -> None:
    with socket.socket() as place:
        place.bind(("127.0.0.1", 0))
        where = f"tcp/127.0.0.1:{place.getsockname()[1]}"
        session, said = Session(), list[str]()
        session.up = [Link("f00", "tcp/127.0.0.1:1", "tcp/127.0.0.1:2")]
        links = Links(ZenohOptions(connect=(where,)), session, said.append)  # type: ignore[arg-type]

        async def status() -> tuple[str, str]:
            for _ in range(3):
                await links.check()
            (found,) = links.status([])
            return found.state, found.text

        assert await status() == ("trying", "connection refused")
        place.listen()
        assert await status() == ("up", "by another link")
        assert said == [f"--connect {where}: connection refused; still trying"]


async def test_a_tunnel_without_a_bridge_is_said_to_be_one_and_never_up_by_another_link() -> None:
    def close(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.close()

    async with await asyncio.start_server(close, "127.0.0.1", 0) as tunnel:
        where = f"tcp/127.0.0.1:{tunnel.sockets[0].getsockname()[1]}"
        session, said = Session(), list[str]()
        session.up = [Link("f00", "tcp/127.0.0.1:1", "tcp/127.0.0.1:2")]  # by another tunnel
        links = Links(ZenohOptions(connect=(where,)), session, said.append)  # type: ignore[arg-type]
        for _ in range(3):
            await links.check()
        reason = "it accepts connections and closes them at once: a tunnel without a bridge?"
        assert said == [f"--connect {where}: {reason}; still trying"]
        assert [(one.state, one.text) for one in links.status([])] == [("trying", reason)]


async def test_a_host_name_that_no_host_can_have_is_unknown() -> None:
    said, host = list[str](), "a" * 64 + ".local"
    links = Links(ZenohOptions(connect=(f"tcp/{host}:7447",)), Session(), said.append)  # type: ignore[arg-type]
    for _ in range(3):
        await links.check()
    assert said == [f"--connect tcp/{host}:7447: the host '{host}' is unknown; still trying"]


async def test_addresses_that_do_not_answer_are_tried_at_once_but_not_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    trying, most, said = 0, 0, list[str]()

    async def look_up(host: str, port: int, **_: object) -> object:
        nonlocal trying, most
        trying += 1
        most = max(most, trying)
        try:
            return await asyncio.Event().wait()
        finally:
            trying -= 1

    monkeypatch.setattr(links_module, "_PROBE_S", 0.01)
    monkeypatch.setattr(links_module, "_AT_ONCE", 4)
    monkeypatch.setattr(asyncio.get_running_loop(), "getaddrinfo", look_up)
    where = tuple(f"tcp/robot{number}:7447" for number in range(10))
    links = Links(ZenohOptions(connect=where), Session(), said.append)  # type: ignore[arg-type]
    for _ in range(3):
        await links.check()
    assert said == [f"--connect {one}: no answer; still trying" for one in where]
    assert (trying, most) == (0, 4)
