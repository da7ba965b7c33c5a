"""The services of a player's node: the same as rosbag2's."""

from typing import Any

from bus.node import Node
from bus_bag.play.player import Player
from bus_bag.serving import offer

__all__ = ["serve"]

_NS_PER_S = 1_000_000_000


async def serve(node: Node, player: Player) -> None:
    """Let `node` serve requests to `player`, until it is closed."""

    async def play_next(request: Any) -> dict[str, Any]:
        return {"success": await player.play_next()}

    async def burst(request: Any) -> dict[str, Any]:
        return {"actually_burst": await player.burst(request.num_messages)}

    async def seek(request: Any) -> dict[str, Any]:
        return {"success": await player.seek(request.time.sec * _NS_PER_S + request.time.nanosec)}

    async def play(request: Any) -> dict[str, Any]:
        # The program ends after the replay, so a replay is always running here, and `play` returns False.
        return {"success": await player.play()}

    await offer(node, "pause", "Pause", lambda request: player.pause())
    await offer(node, "resume", "Resume", lambda request: player.resume())
    await offer(node, "toggle_paused", "TogglePaused", lambda request: player.toggle_paused())
    await offer(node, "is_paused", "IsPaused", lambda request: {"paused": player.is_paused})
    await offer(node, "set_rate", "SetRate", lambda request: {"success": player.set_rate(request.rate)})
    await offer(node, "get_rate", "GetRate", lambda request: {"rate": player.rate})
    await offer(node, "play", "Play", play)
    await offer(node, "play_next", "PlayNext", play_next)
    await offer(node, "burst", "Burst", burst)
    await offer(node, "seek", "Seek", seek)
    await offer(node, "stop", "Stop", lambda request: player.stop())
