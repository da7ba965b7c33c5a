"""turtlesim's page: in a browser, by hand, and without the packages that it needs."""

import asyncio
import re
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, closing
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from browser import chromium, need_chromium
from cli import bus
from conftest import WAIT_S
from neighbours import wait_until
from programs import Program, on_one_loop, running, running_command

pytest.importorskip("websockets", reason="the page's server is made of websockets")

from msgspec import json
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

RUN = ("-m", "bus_cli", "run", "turtlesim", "turtlesim_node")
PAGE = Subprotocol("busd.turtlesim.v1")
WHOLE = 500 * 500 * 4
SPAWN, PEN, JUMP = "turtlesim/srv/Spawn", "turtlesim/srv/SetPen", "turtlesim/srv/TeleportAbsolute"
PIXEL = "return [...document.getElementById('field').getContext('2d').getImageData({x}, {y}, 1, 1).data]"

pytestmark = pytest.mark.usefixtures("daemon")


@asynccontextmanager
async def simulator(folder: Path, *words: str) -> AsyncIterator[tuple[Program, str]]:
    """A running simulator, and the address of its page."""
    async with running(folder, *RUN, *words) as program:
        address = (await program.line(r"^page: (http://\S+)$"))[1]
        await program.line(r"Spawning turtle \[turtle1\]")
        yield program, address


async def call(service: str, kind: str, request: str) -> None:
    said = await asyncio.to_thread(bus, "service", "call", service, kind, request)
    assert said.code == 0, said.err


def status_of(address: str) -> int:
    parts = urlsplit(address)
    with closing(HTTPConnection(parts.netloc, timeout=WAIT_S)) as asking:
        asking.request("GET", f"{parts.path}?{parts.query}")
        return asking.getresponse().status


class Viewer:
    """The messages for a page, until `close`."""

    def __init__(self, address: str) -> None:
        self._stack = ExitStack()
        self.socket = self._stack.enter_context(connect(address.replace("http:", "ws:"), subprotocols=[PAGE]))
        self.close = self._stack.close
        self.picture = self.socket.recv()
        assert isinstance(self.picture, bytes)

    def until(self, fits: Any) -> dict[str, Any]:
        while True:
            told = json.decode(self.socket.recv(timeout=20))
            if fits(told):
                return dict(told)


@on_one_loop
async def test_who_looks_late_sees_all_that_was_drawn(tmp_path: Path) -> None:
    async with simulator(tmp_path) as (_, address):
        first = await asyncio.to_thread(Viewer, address)
        assert first.picture == bytes(WHOLE)
        told = await asyncio.to_thread(first.until, lambda told: told["turtles"])
        assert told["background"] == "#4556ff"
        assert [one["name"] for one in told["turtles"]] == ["turtle1"]
        await call("/turtle1/set_pen", PEN, "{r: 255, g: 1, b: 2, width: 4}")
        await call("/turtle1/teleport_absolute", JUMP, "{x: 1.0, y: 1.0}")
        told = await asyncio.to_thread(first.until, lambda told: told["squares"])
        assert {one[4] for one in told["squares"]} == {"#ff0102"}
        late = await asyncio.to_thread(Viewer, address)
        assert bytes((255, 1, 2, 255)) in late.picture
        await call("/spawn", SPAWN, "{x: 2, y: 2, name: ''}")
        for viewer in (first, late):
            told = await asyncio.to_thread(viewer.until, lambda told: len(told["turtles"]) == 2)
            assert {one["picture"] for one in told["turtles"]} == {0, 1}
        await call("/clear", "std_srvs/srv/Empty", "{}")
        await asyncio.to_thread(late.until, lambda told: told["cleared"])
        await asyncio.to_thread(bus, "param", "set", "/turtlesim", "background_r", "150")
        await asyncio.to_thread(late.until, lambda told: told["background"] == "#9656ff")
        for viewer in (first, late):
            await asyncio.to_thread(viewer.close)


@on_one_loop
async def test_in_a_browser(tmp_path: Path) -> None:
    pytest.importorskip("selenium", reason="the browser is driven by selenium")
    need_chromium()
    with chromium() as page:
        async with simulator(tmp_path) as (_, address):
            await asyncio.to_thread(page.open, address)
            names = (
                "return [...document.querySelectorAll('#turtles tr')].map(one => one.cells[0].textContent)"
            )
            await asyncio.to_thread(page.wait, names, fits=lambda found: found == ["turtle1"])
            assert "token" not in page.driver.current_url
            assert page.run(PIXEL.format(x=10, y=10)) == [0x45, 0x56, 0xFF, 255]
            assert page.run(PIXEL.format(x=249, y=249)) != [0x45, 0x56, 0xFF, 255], "a turtle is there"
            await call("/turtle1/set_pen", PEN, "{r: 255, g: 1, b: 2, width: 9}")
            await call("/turtle1/teleport_absolute", JUMP, "{x: 1.0, y: 1.0}")
            pixel = PIXEL.format(x=150, y=350)
            await asyncio.to_thread(page.wait, pixel, fits=lambda found: found == [255, 1, 2, 255])
            await call("/spawn", SPAWN, "{x: 2, y: 2, name: '<b>bold</b>'}")
            await call("/spawn", SPAWN, "{x: 2, y: 2, name: 'other'}")
            await asyncio.to_thread(page.wait, names, fits=lambda found: found == ["turtle1", "other"])
            await call("/kill", "turtlesim/srv/Kill", "{name: turtle1}")
            await asyncio.to_thread(page.wait, names, fits=lambda found: found == ["other"])
            assert page.run("return document.getElementById('field').ariaLabel") == "Turtles: other"
            await call("/reset", "std_srvs/srv/Empty", "{}")
            await asyncio.to_thread(page.wait, names, fits=lambda found: found == ["turtle1"])
            assert page.run(pixel) == [0x45, 0x56, 0xFF, 255]
            ours = "Multiple readback operations"  # this test makes many of these
            assert [line for line in page.console() if ours not in line] == []
        state = "return document.getElementById('state').textContent"
        await asyncio.to_thread(
            page.wait, state, fits=lambda text: text.startswith("turtlesim_node has ended")
        )


@on_one_loop
async def test_nobody_looks_without_the_token(tmp_path: Path) -> None:
    async with simulator(tmp_path) as (_, address):
        with pytest.raises(InvalidStatus, match="403"):
            await asyncio.to_thread(Viewer, re.sub("token=.*", "token=guess", address))


@on_one_loop
async def test_a_browser_is_opened(tmp_path: Path) -> None:
    browser, said = tmp_path / "browser", tmp_path / "said"
    browser.write_text(f'#!/bin/sh\necho "$1" > {said}.new\nmv {said}.new {said}\n')
    browser.chmod(0o700)
    async with running(tmp_path, *RUN, "--open", BROWSER=str(browser)) as program:
        address = (await program.line(r"^page: (http://\S+)$"))[1]
        await asyncio.to_thread(wait_until, said.exists)
        once = said.read_text().strip()
        assert once.partition("?")[0] == address.partition("?")[0]
        assert once != address
        assert [await asyncio.to_thread(status_of, once) for _ in range(2)] == [303, 403]


@on_one_loop
async def test_where_it_listens(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        async with AsyncExitStack() as stack:
            program = await stack.enter_async_context(running(tmp_path, *RUN, "--listen", place))
            await program.line(rf"^no page: can't listen on {place}: Address already in use; choose another")
            await program.line(r"Spawning turtle \[turtle1\]")
            unix = tmp_path / "page.sock"
            other = await stack.enter_async_context(running(tmp_path, *RUN, "--listen", f"unix:{unix}"))
            await other.line(rf"^first: ssh -NL 8765:{unix} HOST$")
            await other.line(r"^page: http://127.0.0.1:8765/\?token=")
            wrong = await stack.enter_async_context(running(tmp_path, *RUN, "--listen", "0.0.0.0:80"))
            await wrong.line("0.0.0.0 is not loopback; viewers see every message")
            assert await wrong.end() == 2


@on_one_loop
async def test_without_websockets_it_runs_without_a_page(tmp_path: Path) -> None:
    hide = "import sys; sys.modules['websockets'] = None; sys.argv = ['turtlesim_node']; "
    program = f"{hide}from bus_turtlesim.turtlesim_node import main; main()"
    async with running_command(tmp_path, sys.executable, "-c", program) as blind:  # a fork has imported it
        await blind.line(r"^no page: the page needs websockets \(.*\): pip install 'websockets>=15'$")
        await blind.line(r"Spawning turtle \[turtle1\]")
