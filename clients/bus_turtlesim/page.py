"""turtlesim's page: a small server in its own thread, which shows the turtles to browsers.

The node's thread tells it of each step (`Page.show`), and nothing goes the other way: a browser can
change nothing.
"""

import asyncio
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import json

from bus.base.optional import how_to_install
from bus_turtlesim.canvas import Canvas, Colour, Square
from bus_turtlesim.frames import Frames, Pictures, Seen, message
from bus_turtlesim.world import World
from bus_web.entrance import Addresses, open_gate
from bus_web.files import load
from bus_web.listening import ListenError, listening
from bus_web.place import Place

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

__all__ = ["NoPage", "Page"]

_SUBPROTOCOL = "busd.turtlesim.v1"
_PERIOD_S = 1 / 30
"""Between two frames for one browser."""


class NoPage(Exception):
    """There can be no page; the text gives the reason."""


class Page:
    """Serves the page at `place` until `close`. Raises NoPage."""

    addresses: Addresses

    def __init__(self, place: Place) -> None:
        self._frames, self._pictures = Frames(), Pictures()
        self._canvas: Canvas | None = None
        self._scene: tuple[tuple[Seen, ...], Colour] | None = None
        """None: viewers get the next scene even if it is unchanged."""
        self._clearings = 0
        self._viewers: set[asyncio.Event] = set()
        self._loop = asyncio.new_event_loop()
        self._ended = self._loop.create_future()
        self._opened = threading.Event()
        self._failure: NoPage | None = None
        self._thread = threading.Thread(target=self._run, args=(place,), name="page", daemon=True)
        self._thread.start()
        self._opened.wait()
        if self._failure is not None:
            self._thread.join()
            raise self._failure

    def show(self, world: World, background: Colour) -> None:
        """A step is done. Costs almost nothing without a browser."""
        canvas = self._canvas = world.canvas
        squares, canvas.news = canvas.news or [], []
        is_cleared, self._clearings = canvas.clearings != self._clearings, canvas.clearings
        if self._viewers:
            seen = self._pictures.update(world.turtles.items())
            self._loop.call_soon_threadsafe(self._take, seen, background, squares, is_cleared)

    def close(self) -> None:
        """Browsers are told that it ends."""
        self._loop.call_soon_threadsafe(self._ended.set_result, None)
        self._thread.join()

    # --- in its thread

    def _run(self, place: Place) -> None:
        try:
            self._loop.run_until_complete(self._serve(place))
        finally:
            self._opened.set()
            self._loop.close()

    async def _serve(self, place: Place) -> None:
        try:
            from bus_web.server import Server
        except ImportError as error:
            self._failure = NoPage(f"the page needs websockets ({error}): {how_to_install('websockets')}")
            return
        try:
            with listening(place) as (listener, here):
                gate, self.addresses = open_gate(here)
                server = Server(gate, load(Path(__file__).with_name("page")), {_SUBPROTOCOL: self._view})
                await server.open(listener)
                self._opened.set()
                try:
                    await self._ended
                finally:
                    await server.close()
        except ListenError as error:
            self._failure = NoPage(str(error))

    def _take(
        self, seen: tuple[Seen, ...], background: Colour, squares: list[Square], is_cleared: bool
    ) -> None:
        is_other = (seen, background) != self._scene
        self._scene = seen, background
        if squares or is_cleared:
            self._frames.add(squares, is_cleared=is_cleared)
        if is_other or squares or is_cleared:
            for news in self._viewers:
                news.set()

    async def _view(self, connection: "ServerConnection") -> None:
        """Send one browser the frames that it has not had, as fast as it reads."""
        news = asyncio.Event()
        self._viewers.add(news)  # before the picture is taken: later drawing is sent after it
        self._scene = None
        listening = asyncio.ensure_future(connection.wait_closed())
        listening.add_done_callback(lambda _: news.set())
        try:
            number = -1
            while not listening.done():
                await news.wait()
                news.clear()
                number = await self._send(connection, number)
                await asyncio.sleep(_PERIOD_S)
        finally:
            self._viewers.discard(news)
            listening.cancel()

    async def _send(self, connection: "ServerConnection", number: int) -> int:
        """Returns the number of the frame that it has now."""
        scene = self._scene
        if scene is None:  # another one came, and the next step will say
            return number
        newest = self._frames.newest
        found = self._frames.since(number) if number >= 0 else None
        if found is None:
            picture = self._canvas.picture() if self._canvas is not None else b""
            await connection.send(picture)
            found = False, []
        is_cleared, squares = found
        told: Any = message(*scene, squares, is_cleared=is_cleared)
        await connection.send(json.encode(told).decode())
        return newest
