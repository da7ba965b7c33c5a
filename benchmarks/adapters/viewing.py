"""The processes of web.py: many topics, and their viewers: a browser, a page, Foxglove's clients."""

import asyncio
import json
import shutil
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from statistics import median
from time import time_ns
from typing import Any

import msgspec

import bus
from benchmarks.worker import Parent, options, run
from bus.msg.sensor_msgs import Imu
from bus.msg.std_msgs import String

_NODES, _TOPICS_EACH = 200, 5
_DRAWN = """
const done = arguments[0], look = () => {
  const found = performance.getEntriesByName('first graph')[0];
  found ? done(found.startTime) : setTimeout(look, 50);
};
look();
"""
_STAMP = struct.Struct("<iI")
_STAMP_AT = 1 + 4 + 8 + 4
"""Position of the stamp in a frame with a message: after kind, subscription, time, and the CDR's head."""


class View(msgspec.Struct, frozen=True, kw_only=True):
    """A viewer of kind `who`, which looks at `topics` for a number of `messages`."""

    who: str
    host: str = ""
    """Host and port of `bus web`."""
    token: str = ""
    topics: list[str] = []
    messages: int = 0


async def main(parent: Parent) -> None:
    view: View = options(View)
    await _ROLES[view.who](parent, view)
    await asyncio.Event().wait()


async def _crowd(parent: Parent, view: View) -> None:
    nodes = [bus.Node(f"node_{number}", rosout=False) for number in range(_NODES)]
    for number, node in enumerate(nodes):
        await node.open()
        for topic in range(number * _TOPICS_EACH, (number + 1) * _TOPICS_EACH):
            await node.create_publisher(String, f"topic_{topic}", 10)
        await node.create_subscription(String, f"topic_{(number * 5 + 7) % 1000}", 10)
    parent.tell("ready")
    await asyncio.Event().wait()


async def _browse(parent: Parent, view: View) -> None:
    """A headless Chromium: `drawn` is the time from entering the address until it has drawn a graph."""
    from selenium import webdriver

    settings = webdriver.ChromeOptions()
    settings.binary_location = shutil.which("chromium") or ""
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        settings.add_argument(word)
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    driver = await asyncio.to_thread(webdriver.Chrome, options=settings, service=service)
    try:
        parent.tell("ready")
        await asyncio.to_thread(driver.get, await parent.next_word())
        drawn_ms = await asyncio.to_thread(driver.execute_async_script, _DRAWN)
    finally:
        await asyncio.to_thread(driver.quit)
    parent.tell("drawn", ms=drawn_ms)


@asynccontextmanager
async def _connected(view: View, subprotocol: str) -> AsyncIterator[Any]:
    from websockets.asyncio.client import connect
    from websockets.typing import Subprotocol

    address = f"ws://{view.host}/?token={view.token}"
    async with connect(
        address, subprotocols=[Subprotocol(subprotocol)], max_size=None, compression=None, proxy=None
    ) as socket:
        yield socket


async def _page(parent: Parent, view: View) -> None:
    """A page that shows all topics at once."""
    async with _connected(view, "busd.page.v1") as socket:
        await socket.send(json.dumps({"op": "look", "topics": {topic: [] for topic in view.topics}}))
        await socket.send(json.dumps({"op": "log", "on": True}))
        waiting = {*view.topics}
        while True:
            told = json.loads(await socket.recv())
            if told["op"] == "value" and waiting:
                waiting.discard(told["topic"])
                if not waiting:
                    parent.tell("looks")


async def _subscribed(socket: Any, topic: str) -> None:
    while True:
        told = json.loads(await socket.recv())
        for channel in told.get("channels", ()):
            if channel["topic"] == topic:
                wanted = [{"id": 1, "channelId": channel["id"]}]
                await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                return


async def _foxglove(parent: Parent, view: View) -> None:
    """A viewer of Foxglove's protocol: reports the age of messages at their arrival, by their stamps."""
    async with _connected(view, "foxglove.sdk.v1") as socket:
        await _subscribed(socket, *view.topics)
        ages: list[int] = []
        while len(ages) < view.messages:
            frame = await socket.recv()
            if isinstance(frame, bytes) and frame[0] == 1:
                ages.append(_age_ns(*_STAMP.unpack_from(frame, _STAMP_AT)))
        parent.tell("ages", p50_us=median(ages) / 1e3)
        await asyncio.Event().wait()


async def _subscribe(parent: Parent, view: View) -> None:
    """A subscription on the bus: reports the same ages."""
    ages: list[int] = []
    enough = asyncio.Event()

    def hear(message: Imu) -> None:
        ages.append(_age_ns(message.header.stamp.sec, message.header.stamp.nanosec))
        if len(ages) == view.messages:
            enough.set()

    async with bus.Node("looker") as node:
        await node.create_subscription(Imu, view.topics[0], bus.qos.sensor_data, hear)
        await enough.wait()
        parent.tell("ages", p50_us=median(ages[: view.messages]) / 1e3)
        await asyncio.Event().wait()


async def _stop_reading(parent: Parent, view: View) -> None:
    """A viewer that subscribes and then stops reading."""
    async with _connected(view, "foxglove.sdk.v1") as socket:
        await _subscribed(socket, *view.topics)
        parent.tell("stopped")
        await asyncio.Event().wait()


def _age_ns(sec: int, nanosec: int) -> int:
    return time_ns() - (sec * 1_000_000_000 + nanosec)


_ROLES = {
    "crowd": _crowd,
    "browser": _browse,
    "page": _page,
    "foxglove": _foxglove,
    "subscription": _subscribe,
    "stopped": _stop_reading,
}

if __name__ == "__main__":
    run(main)
