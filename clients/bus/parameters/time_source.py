"""Feeds simulated time from /clock to a node's clock, while the node's parameter use_sim_time is true.

Must not know the store of parameters, or how a node subscribes.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Final

from bus.clock import Clock
from bus.errors import BusError
from bus.logger import Logger
from bus.qos import QoSProfile, Reliability
from bus.subscription import Subscription

__all__ = ["CLOCK_QOS", "CLOCK_TOPIC", "TimeSource"]

CLOCK_TOPIC: Final = "/clock"
CLOCK_QOS: Final = QoSProfile(depth=1, reliability=Reliability.BEST_EFFORT)

_NS_PER_S = 1_000_000_000


class TimeSource:
    """The source of one clock's time; `subscribe` makes a subscription to /clock with the given callback."""

    def __init__(
        self,
        clock: Clock,
        logger: Logger,
        subscribe: Callable[[Callable[[Any], None]], Awaitable[Subscription[Any]]],
    ) -> None:
        self._clock = clock
        self._logger = logger
        self._subscribe = subscribe
        self._subscription: Subscription[Any] | None = None
        self._wants = False
        self._task: asyncio.Task[None] | None = None

    def follow(self, is_simulated: bool) -> None:
        """Use simulated time, or the machine's again. A task makes or closes the subscription."""
        self._wants = is_simulated
        self._clock.simulate(is_simulated)
        if self._task is None and (self._subscription is not None) is not is_simulated:
            self._task = asyncio.create_task(self._settle(), name="following /clock")

    async def settled(self) -> None:
        """Wait until the subscription agrees with the last call of `follow`."""
        if self._task is not None:
            await asyncio.wait([self._task])

    def close(self) -> None:
        """End. The node closes the subscription."""
        if self._task is not None:
            self._task.cancel()

    async def _settle(self) -> None:
        try:
            while (self._subscription is not None) is not self._wants:
                if self._subscription is None:
                    self._subscription = await self._subscribe(self._take)
                else:
                    subscription, self._subscription = self._subscription, None
                    await subscription.close()
        except (BusError, TimeoutError) as error:
            self._logger.error(f"no simulated time: {error}")
        finally:
            self._task = None

    def _take(self, message: Any) -> None:
        """Use the time of a received rosgraph_msgs/msg/Clock."""
        sec, nanosec = message.clock.sec, message.clock.nanosec
        if sec < 0:  # any program may publish there
            self._logger.error(
                f"'{CLOCK_TOPIC}' has no time: {sec} s is before 1970", throttle_duration_sec=1.0
            )
            return
        self._clock.set(sec * _NS_PER_S + nanosec)
