"""The parameters and the clock of one node.

Owns: the start of a node's parameter services, for which a node without parameters doesn't pay; the link
between its clock and `use_sim_time`. Must not know: allowed values (`bus.parameters.values`), or the services
themselves (`bus.parameters.server`).
"""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from typing import TYPE_CHECKING, Any

from bus.clock import Clock, Rate
from bus.errors import AccessDenied, CommandLineError, ConfigurationError, ConnectionClosed
from bus.publisher import Publisher
from bus.qos import parameter_events

if TYPE_CHECKING:  # most programs need none of them
    from bus.parameters.owner import ParameterOwner
    from bus.parameters.parameter_set import ParameterSet
    from bus.parameters.server import ParameterServer
    from bus.parameters.store import Change
    from bus.parameters.time_source import TimeSource
    from bus.process.ros_args import ParameterSource
    from bus.subscription import Subscription

__all__ = ["ServedParameters"]

_USE_SIM_TIME = "use_sim_time"
"""The parameter of every node."""


class ServedParameters:
    """The parameters and the clock of `node`. `settings`: the parameters of the command line.

    Raises CommandLineError for unusable settings, for example a broken file.
    """

    def __init__(self, node: "ParameterOwner", settings: "Sequence[ParameterSource]") -> None:
        self._node = node
        self.clock = Clock(node.full_name)
        """The clock, with the time that `use_sim_time` chooses."""
        self._overrides: dict[str, Any] = {}
        self._parameters: ParameterSet | None = None
        self._server: ParameterServer | None = None
        self._time_source: TimeSource | None = None
        self._starting: asyncio.Task[None] | None = None
        self._has_served = False
        """A node that is opened again still has its parameters."""
        self._is_open = False
        if settings:
            from bus.parameters import file

            try:
                sections = file.load(settings)
            except ConfigurationError as error:
                raise CommandLineError(str(error)) from None
            self._overrides = file.overrides(sections, node.full_name)

    @property
    def parameters(self) -> "ParameterSet":
        """The values and rules, before and after the start of the services."""
        if self._parameters is None:
            from bus.parameters.parameter_set import ParameterSet

            self._parameters = ParameterSet(
                self._node.full_name, self._overrides, {_USE_SIM_TIME: False}, self._notify
            )
        return self._parameters

    async def open(self) -> None:
        """Start, now that the node is in the graph."""
        self._is_open = True
        if self._overrides or self._has_served:
            await self.serve()
        if self._parameters is not None:
            self._follow_time(self._parameters.below("").get(_USE_SIM_TIME))
        await self._settled()

    def close(self) -> None:
        """End. The node closes the services and subscriptions with all its other endpoints."""
        if self._starting is not None:
            self._starting.cancel()
        if self._time_source is not None:
            self._time_source.close()
        self.clock.close()
        self.clock = Clock(self._node.full_name)  # for a node that is opened again
        self._starting = self._server = self._time_source = None
        self._is_open = False

    async def serve(self) -> None:
        """Start the services. Cancellation: the start continues, for other declarations that wait for it."""
        self._node._opened()
        if self._server is not None:
            return
        if self._starting is None:
            self._starting = asyncio.create_task(self._start(), name="serving parameters")
            self._starting.add_done_callback(self._start_ended)
        starting = self._starting
        await asyncio.wait([starting])
        if starting.cancelled():
            raise ConnectionClosed(f"node {self._node.full_name} is closed")
        starting.result()

    async def declare(self, name: str, default: Any, **rules: Any) -> Any:
        """As `ParameterSet.declare`; the first declaration starts the services."""
        await self.serve()
        value = self.parameters.declare(name, default, **rules)
        if name == _USE_SIM_TIME:
            await self._settled()
        return value

    async def _settled(self) -> None:
        """Wait until the clock uses the time that `use_sim_time` has chosen last."""
        if self._time_source is not None:
            await self._time_source.settled()

    def create_rate(self, hz: float) -> Rate:
        """A rate by this clock."""
        self._node._opened()
        return Rate(hz, self.clock)

    def _start_ended(self, starting: "asyncio.Task[None]") -> None:
        if self._starting is starting:
            self._starting = None
        if not starting.cancelled():
            starting.exception()  # mark the error as seen: perhaps no call waits any more

    async def _start(self) -> None:
        from bus.parameters.server import EVENTS_TOPIC, ParameterServer, event_class

        events: Publisher[Any] | None = None
        try:
            # Each node has this publisher, and most change little: a ring is not worth its memory.
            events = await self._node._create_publisher(
                event_class(), EVENTS_TOPIC, parameter_events, by_socket=True
            )
        except AccessDenied as denied:
            self._node.get_logger().warning(f"changes of parameters are told to nobody: {denied}")
        server = ParameterServer(self._node, self.parameters, self.clock, events)
        try:
            await server.open()
        except BaseException:
            if events is not None:
                await events.close()
            raise
        self._server, self._has_served = server, True

    def _notify(self, change: "Change[Any]") -> None:
        if self._server is not None:
            self._server.publish_event(change)
        for one in (*change.new, *change.changed):
            if one.name == _USE_SIM_TIME:
                self._follow_time(one.value)

    def _follow_time(self, use_sim_time: object) -> None:
        is_simulated = use_sim_time is True  # a program may have declared it with any type
        if self._time_source is None:
            if not is_simulated or not self._is_open:
                return
            from bus.parameters.time_source import TimeSource

            self._time_source = TimeSource(self.clock, self._node.get_logger(), self._subscribe_to_clock)
        self._time_source.follow(is_simulated)

    def _subscribe_to_clock(self, callback: Callable[[Any], None]) -> "Awaitable[Subscription[Any]]":
        from bus.parameters.time_source import CLOCK_QOS, CLOCK_TOPIC
        from bus.types.classes import message_class

        clock_class = message_class("rosgraph_msgs/msg/Clock")
        return self._node.create_subscription(clock_class, CLOCK_TOPIC, CLOCK_QOS, callback)
