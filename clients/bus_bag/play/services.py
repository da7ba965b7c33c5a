"""The services of a player's node: those of rosbag2's."""

from typing import Any

from bus.node import Node
from bus.types.classes import service_class
from bus_bag.play.player import Player

__all__ = ["serve"]

_NS_PER_S = 1_000_000_000


async def serve(node: Node, player: Player) -> None:
    """Have `node` do with `player` what others ask for, until it is closed."""

    async def offer(name: str, service: str, answer: Any) -> None:
        """`answer` takes the request, and returns the fields of the response."""
        cls = service_class(f"rosbag2_interfaces/srv/{service}")

        async def respond(request: Any) -> Any:
            fields = answer(request)
            return cls.Response(**(await fields if hasattr(fields, "__await__") else fields or {}))

        await node.create_service(cls, f"~/{name}", respond)

    async def play_next(request: Any) -> dict[str, Any]:
        return {"success": await player.play_next()}

    async def burst(request: Any) -> dict[str, Any]:
        return {"actually_burst": await player.burst(request.num_messages)}

    async def seek(request: Any) -> dict[str, Any]:
        return {"success": await player.seek(request.time.sec * _NS_PER_S + request.time.nanosec)}

    async def play(request: Any) -> dict[str, Any]:
        # The program ends when it has played, so there always is a replay, and `play` says no.
        return {"success": await player.play()}

    await offer("pause", "Pause", lambda request: player.pause())
    await offer("resume", "Resume", lambda request: player.resume())
    await offer("toggle_paused", "TogglePaused", lambda request: player.toggle_paused())
    await offer("is_paused", "IsPaused", lambda request: {"paused": player.is_paused})
    await offer("set_rate", "SetRate", lambda request: {"success": player.set_rate(request.rate)})
    await offer("get_rate", "GetRate", lambda request: {"rate": player.rate})
    await offer("play", "Play", play)
    await offer("play_next", "PlayNext", play_next)
    await offer("burst", "Burst", burst)
    await offer("seek", "Seek", seek)
    await offer("stop", "Stop", lambda request: player.stop())
