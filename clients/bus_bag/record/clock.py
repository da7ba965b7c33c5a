"""The clock of log times: the system's, or the topic /clock."""

import asyncio
from time import time_ns
from typing import Any

from bus.node import Node
from bus.parameters.time_source import CLOCK_QOS, CLOCK_TOPIC
from bus.subscription import Subscription
from bus.types.classes import message_class

__all__ = ["RecordingClock"]


class RecordingClock:
    """The clock of one recording; `is_simulated`: use the clock of `node`, which follows /clock."""

    def __init__(self, node: Node, *, is_simulated: bool) -> None:
        self._node = node
        self.is_simulated = is_simulated

    def now_ns(self) -> int:
        """Nanoseconds since 1970, or since the simulation began; 0 before its beginning."""
        if not self.is_simulated:
            return time_ns()
        now: Any = self._node.now()
        return int(now.sec) * 1_000_000_000 + int(now.nanosec)

    async def wait_for_begin(self, stopped: asyncio.Event) -> None:
        """Wait until there is a time, or until `stopped`."""
        if not self.is_simulated or self.now_ns():
            return
        log = self._node.get_logger()
        log.info("use_sim_time set, waiting for /clock before starting recording...")
        clock = await self._node.create_subscription(
            message_class("rosgraph_msgs/msg/Clock"), CLOCK_TOPIC, CLOCK_QOS
        )
        receiving = asyncio.ensure_future(_first_time(clock))
        stopping = asyncio.ensure_future(stopped.wait())
        try:
            await asyncio.wait((receiving, stopping), return_when=asyncio.FIRST_COMPLETED)
            if receiving.done():
                await receiving  # raises what has ended the subscription
            # The node's own subscription may get the same message a moment later.
            while not (self.now_ns() or stopped.is_set()):  # noqa: ASYNC110
                await asyncio.sleep(0.001)
        finally:
            receiving.cancel()
            stopping.cancel()
            await clock.close()
        if not stopped.is_set():
            log.info("Sim time /clock found, starting recording.")


async def _first_time(clock: Subscription[Any]) -> None:
    """Wait for a time. A simulator may publish 0 until its simulation begins."""
    time = None
    while time is None or time.sec < 0 or not (time.sec or time.nanosec):
        time = (await clock.receive())[0].clock
