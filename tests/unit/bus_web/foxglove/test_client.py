"""What one client is sent."""

from bus_web.foxglove.protocol import Level
from web_world import WebWorld


async def test_statuses() -> None:
    world = WebWorld()
    world.client.say(Level.WARNING, "slow", "id")
    world.client.say(Level.ERROR, "no")
    assert await world.told() == [
        {"op": "status", "level": 1, "message": "slow", "id": "id"},
        {"op": "status", "level": 2, "message": "no"},
    ]
    await world.close()
