"""One open page."""

import asyncio
from contextlib import suppress

import msgspec
import pytest

from bus.msg.std_msgs import Float64MultiArray
from bus_web import hub, page_session
from bus_web.page_session import PageSession
from semantics import until
from web_world import ListSocket, WebWorld


async def test_a_value_has_the_extremes_of_the_messages_before_it() -> None:
    """Of eight messages that come at once a page shows the first and the last."""
    world = WebWorld()
    publisher = world.add("publisher", "/sensor", "/numbers", Float64MultiArray)
    world.look()
    session = PageSession(world.hub, world.socket, "a bus")
    running = asyncio.get_running_loop().create_task(session.run())
    look = {"op": "look", "topics": {"/numbers": []}, "plots": {"/numbers": ["data.9"]}}
    world.socket.said.put_nowait(msgspec.json.encode(look).decode())
    await until(lambda: world.node.subscriptions)
    for at_s, number in enumerate((0, 1, -7, 2, 9, 3, 4, 5)):
        world.publish(publisher, Float64MultiArray(data=[0.0] * 9 + [number]), sent_ns=at_s * 1_000_000_000)
    values: list[dict[str, object]] = []

    def has_both() -> bool:
        values[:] = [told for told in world.socket.texts() if told["op"] == "value"]
        return len(values) == 2

    await until(has_both)
    assert [value["at_ms"] for value in values] == [0, 7000]
    assert "ends" not in values[0], "the value itself says it"
    assert (values[1]["from_ms"], values[1]["ends"]) == (1000, {"data.9": [-7, 9]})
    world.publish(publisher, Float64MultiArray(), sent_ns=8_000_000_000)
    world.socket.said.put_nowait('{"op":"look","topics":{}}')
    await until(lambda: not session._looks)
    running.cancel()
    with suppress(asyncio.CancelledError):
        await running
    await world.close()


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


async def test_a_page_learns_of_the_loss_of_busd_at_any_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    """One is opened while busd is away; another one is slow at that moment."""
    for name in ("_LOOK_S", "_REST_S", "_CONNECTION_S"):
        monkeypatch.setattr(hub, name, 0.001)
    world = WebWorld()
    world.look()
    slow, late = ListSocket(), ListSocket()
    slow.may_send.clear()
    async with asyncio.TaskGroup() as group:
        running = [group.create_task(PageSession(world.hub, slow, "a bus").run())]
        await until(lambda: world.hub.has_looked)
        monkeypatch.setattr(world.node, "is_connected", False)
        await until(lambda: world.hub.is_lost)
        slow.may_send.set()
        running.append(group.create_task(PageSession(world.hub, late, "a bus").run()))
        for socket in (slow, late):
            await until(lambda socket=socket: any(one["op"] == "bus" for one in socket.texts()))
            assert [one["is_up"] for one in socket.texts() if one["op"] == "bus"] == [False]
        for task in running:
            task.cancel()
    await world.close()
