"""turtlesim's page: the data sent to one browser."""

from typing import Any, cast

import msgspec
import pytest

from bus_turtlesim.page import Page
from bus_web.place import Place

pytest.importorskip("websockets", reason="the page's server is made of websockets")


async def test_another_browser_comes_while_one_is_sent_the_picture() -> None:
    page = Page(Place("127.0.0.1", 0))
    sent: list[bytes | str] = []

    class Connection:
        async def send(self, data: bytes | str) -> None:
            sent.append(data)
            page._scene = None

    try:
        page._scene = (), (0x45, 0x56, 0xFF)
        assert await page._send(cast(Any, Connection()), -1) == 0
        picture, frame = sent
        assert picture == b""
        assert msgspec.json.decode(frame)["background"] == "#4556ff"
        assert await page._send(cast(Any, Connection()), 0) == 0
        assert len(sent) == 2, "until the next step there is nothing to say"
    finally:
        page.close()
