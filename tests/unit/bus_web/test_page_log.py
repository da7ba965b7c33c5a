"""Lines of /rosout for one page."""

import asyncio
from typing import Any

import pytest

from bus.msg.builtin_interfaces import Time
from bus.msg.std_msgs import String
from bus.types.classes import message_class
from bus_web import page_log as module
from bus_web.page_log import PageLog
from semantics import until
from web_world import WebWorld, turns

LOG: Any = message_class("rcl_interfaces/msg/Log")


def line(text: str, name: str = "arm") -> Any:
    return LOG(stamp=Time(sec=2, nanosec=500_000_000), level=30, name=name, msg=text)


async def test_as_long_as_it_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PERIOD_S", 0.001)
    monkeypatch.setattr(module, "_MOST_LINES", 2)
    world = WebWorld()
    rosout = world.add("publisher", "/arm", "/rosout", LOG)
    world.look()
    log = PageLog(world.hub.subscriptions, world.client)
    sending = asyncio.get_running_loop().create_task(world.client.run())
    log.show(on=True)
    log.show(on=True)
    await turns()
    for text in ("one", "two", "<b>" + "x" * 5000):
        world.publish(rosout, line(text, name="arm" if text != "two" else "arm" * 1000))
    await until(lambda: world.socket.sent)
    (told,) = world.socket.texts()
    assert told["left_out"] == 1
    assert [one[:3] for one in told["lines"]] == [[2500, 30, ("arm" * 67)[:200]], [2500, 30, "arm"]]
    assert [len(one[3]) for one in told["lines"]] == [3, 2000]
    world.publish(rosout, line("never"))
    log.show(on=False)
    await turns()
    (subscription,) = world.node.subscriptions["/rosout"]
    assert subscription.is_closed
    assert log._timer is None, "nothing comes any more"
    assert len(world.socket.sent) == 1
    sending.cancel()
    await asyncio.gather(sending, return_exceptions=True)
    await world.close()


async def test_a_page_that_does_not_read_is_told_later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_PERIOD_S", 0.001)
    world = WebWorld()
    rosout = world.add("publisher", "/arm", "/rosout", LOG)
    world.look()
    log = PageLog(world.hub.subscriptions, world.client)
    world.client.notify(b"{}")
    log.show(on=True)
    await turns()
    for _ in range(3):
        world.publish(rosout, line("x"))
        timer = log._timer
        await until(lambda timer=timer: log._timer is not timer)
    assert world.client.notices == 1
    sending = asyncio.get_running_loop().create_task(world.client.run())
    await until(lambda: len(world.socket.sent) == 2)
    assert len(world.socket.texts()[1]["lines"]) == 3
    log.show(on=False)
    sending.cancel()
    await asyncio.gather(sending, return_exceptions=True)
    await world.close()


async def test_a_topic_of_another_type_is_no_log() -> None:
    world = WebWorld()
    rosout = world.add("publisher", "/arm", "/rosout", String)
    world.look()
    log = PageLog(world.hub.subscriptions, world.client)
    log.show(on=True)
    await turns()
    world.publish(rosout, String(data="x"))
    assert log._timer is None
    log.show(on=False)
    await world.close()
