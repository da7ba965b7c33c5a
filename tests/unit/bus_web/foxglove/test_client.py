"""The data sent to one client."""

from bus_web.foxglove.protocol import Level
from web_world import WebWorld


async def test_who_does_not_read_gets_no_more_answers_than_can_wait() -> None:
    world = WebWorld()
    for _ in range(12):
        world.client.answer(bytes(1 << 20), b"{}")
    assert (world.client.notices, world.client.notice_bytes) == (12, (8 << 20) + 8)
    assert await world.told() == 4 * [{}]
    world.client.answer(bytes(9 << 20), b"{}")
    assert await world.told() == [], "one that reads gets it, however large"
    assert len(world.socket.sent[-1]) == 9 << 20
    await world.close()


async def test_statuses() -> None:
    world = WebWorld()
    world.client.say(Level.WARNING, "slow", "id")
    world.client.say(Level.ERROR, "no")
    assert await world.told() == [
        {"op": "status", "level": 1, "message": "slow", "id": "id"},
        {"op": "status", "level": 2, "message": "no"},
    ]
    await world.close()


async def test_a_status_is_sent_once_until_it_is_removed() -> None:
    world = WebWorld()
    for _ in range(3):
        for id in ("a", "b", None):
            world.client.say(Level.WARNING, "away", id)
    assert [told.get("id") for told in await world.told()] == ["a", "b", None]
    world.client.remove_status("a")
    for id in ("a", "b", None):
        world.client.say(Level.WARNING, "away", id)
    assert await world.told() == [
        {"op": "removeStatus", "statusIds": ["a"]},
        {"op": "status", "level": 1, "message": "away", "id": "a"},
    ]
    await world.close()


async def test_statuses_without_end_cost_little() -> None:
    world = WebWorld()
    for number in range(1000):
        world.client.say(Level.WARNING, f"mistake {number}")
    assert len(world.client._said) == 256
    assert len(await world.told()) == 1000
    world.client.say(Level.WARNING, "mistake 0")  # it is no longer remembered
    world.client.say(Level.WARNING, "mistake 999")
    assert [told["message"] for told in await world.told()] == ["mistake 0"]
    await world.close()
