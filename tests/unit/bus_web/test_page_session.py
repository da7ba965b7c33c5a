"""One open page."""

import asyncio
from contextlib import suppress

import msgspec

from bus.msg.std_msgs import Float64MultiArray
from bus_web import page_session
from bus_web.page_session import PageSession
from semantics import until
from web_world import WebWorld


async def test_what_is_made_of_a_message_is_kept_for_a_few_pages_only() -> None:
    """A page may open one array of a message after the other, again and again."""
    world = WebWorld()
    publisher = world.add("publisher", "/sensor", "/numbers", Float64MultiArray)
    world.look()
    session = PageSession(world.hub, world.socket, "a bus")
    running = asyncio.get_running_loop().create_task(session.run())

    def look(path: str) -> None:
        said = {"op": "look", "topics": {"/numbers": [path]}}
        world.socket.said.put_nowait(msgspec.json.encode(said).decode())

    def values() -> list[object]:
        return [told for told in world.socket.texts() if told["op"] == "value"]

    look("data")
    await until(lambda: world.node.subscriptions)
    world.publish(publisher, Float64MultiArray(data=[0.0] * 20))
    for number in range(1, 2 * page_session._MOST_FRAMES):
        await until(lambda number=number: len(values()) == number)
        look(f"data.{number}")
    heard = session._looks["/numbers"].shown
    assert heard is not None
    assert len(heard.frames) <= page_session._MOST_FRAMES
    running.cancel()
    with suppress(asyncio.CancelledError):
        await running
    await world.close()
