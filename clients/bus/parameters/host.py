"""The part of a node that has parameters and time.

Owns: when a node begins to serve its parameters, so that one without any doesn't pay for them. Must not know:
which values are allowed (`bus.parameters.store`), or what else a node has.
"""

import asyncio
from abc import abstractmethod
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, overload

from bus.clock import Clock, Rate
from bus.errors import AccessDenied, CommandLineError, ConfigurationError, ConnectionClosed
from bus.process.ros_args import Arguments
from bus.publisher import Publisher
from bus.qos import QoS, parameter_events
from bus.service_host import ServiceHost

if TYPE_CHECKING:  # most programs need neither
    from bus.msg.builtin_interfaces import Time
    from bus.parameters.server import ParameterServer
    from bus.parameters.store import ParameterSet
    from bus.parameters.time_source import TimeSource
    from bus.parameters.values import Change
    from bus.subscription import Subscription

__all__ = ["ParameterHost"]

Value: TypeAlias = bool | int | float | str | bytes | list[bool] | list[int] | list[float] | list[str]
"""What a parameter can be."""
V = TypeVar("V", bound=Value)

_S = 1_000_000_000
_USE_SIM_TIME = "use_sim_time"
"""The parameter that every node has."""


class ParameterHost(ServiceHost):
    """Base of Node."""

    _takes_parameters = True
    """False where somebody else does what the command line says of parameters."""

    @abstractmethod
    async def _create_publisher(
        self, message_type: type[Any], topic: str, qos: QoS, *, by_socket: bool = False
    ) -> Publisher[Any]: ...

    @abstractmethod
    def create_subscription(
        self, message_type: type[Any], topic: str, qos: QoS, callback: Callable[[Any], object]
    ) -> "Awaitable[Subscription[Any]]": ...

    # --- parameters

    @overload
    async def declare_parameter(
        self,
        name: str,
        default: V,
        *,
        range: Sequence[float] | None = None,
        read_only: bool = False,
        description: str = "",
        additional_constraints: str = "",
    ) -> V: ...

    @overload
    async def declare_parameter(
        self,
        name: str,
        default: None = None,
        *,
        type: type[V],
        range: Sequence[float] | None = None,
        read_only: bool = False,
        description: str = "",
        additional_constraints: str = "",
    ) -> V | None: ...

    @overload
    async def declare_parameter(
        self,
        name: str,
        default: Value,
        *,
        type: type[V],
        range: Sequence[float] | None = None,
        read_only: bool = False,
        description: str = "",
        additional_constraints: str = "",
    ) -> V: ...

    @overload
    async def declare_parameter(
        self,
        name: str,
        default: Value | None = None,
        *,
        dynamic_typing: bool,
        range: Sequence[float] | None = None,
        read_only: bool = False,
        description: str = "",
        additional_constraints: str = "",
    ) -> Any: ...

    async def declare_parameter(
        self,
        name: str,
        default: Any = None,
        *,
        type: Any = None,
        range: Sequence[float] | None = None,
        read_only: bool = False,
        dynamic_typing: bool = False,
        description: str = "",
        additional_constraints: str = "",
    ) -> Any:
        """Declare a parameter, and return its value: that of the command line (`-p name:=value`,
        `--params-file`), or else `default`.

            rate = await node.declare_parameter("rate", 10.0, range=(1, 100), description="Hz")

        A value is a bool, int, float, str, bytes, or a list of bool, int, float or str. Its type stays that
        of `default`; `type=float` or `type=list[str]` says it where there is no default (then the value is
        None until one is given) or an empty list. With `dynamic_typing` the type may change, and others may
        delete the parameter. `range` is (lowest, highest) or (lowest, highest, step), both ends included, for
        an int or a float. A `read_only` one keeps the value that it is declared with. `description` and
        `additional_constraints` are for people: `bus param describe` shows them.

        The first declaration makes the six services by which other programs see the node's parameters, and
        the publisher of /parameter_events. Raises ParameterError for a name, value or range that can't be,
        or where a callback refuses; CommandLineError where the value is the command line's. Cancellation: not
        declared.
        """
        from bus.parameters.store import Description

        await self._serve_parameters()
        value = self._parameter_set().declare(
            name,
            default,
            type_=type,
            description=Description(description, additional_constraints),
            limits=range,
            is_read_only=read_only,
            is_dynamic=dynamic_typing,
        )
        if name == _USE_SIM_TIME and self._time_source is not None:
            await self._time_source.settled()
        return value

    def undeclare_parameter(self, name: str) -> None:
        """Remove a parameter. Raises ParameterError where it is not declared, or read-only."""
        self._parameter_set().undeclare(name)

    def has_parameter(self, name: str) -> bool:
        """Whether it is declared."""
        return name in self._parameter_set()

    def get_parameter(self, name: str) -> Any:
        """The value of a parameter, with the type that it was declared with; lists are copies.

        Raises ParameterError where it is not declared, or has no value yet.
        """
        return self._parameter_set().get(name)

    def get_parameters(self, prefix: str = "") -> dict[str, Any]:
        """Values by name, of all parameters that have one.

        With `prefix` "arm" those of `arm.length`, `arm.joint.gain` and so on, as `length` and `joint.gain`.
        """
        return self._parameter_set().below(prefix)

    def set_parameter(self, name: str, value: Any) -> None:
        """Set one parameter, as other programs can: the callbacks are asked, the change is told.

        Raises ParameterError where it is not declared, or the value is refused; then nothing has changed.
        """
        self._parameter_set().set({name: value})

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Set several parameters, all or none. Raises as `set_parameter`."""
        self._parameter_set().set(values)

    def pre_set_parameters(self, callback: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        """Call `callback(values)` before parameters are set; it returns what is to be set instead, as a dict.

        `values` are those of one change, by name. All callbacks for parameters are plain functions; what
        they raise comes out of the call that sets, or out of the node where another program sets. The one
        that was added last is called first. Of declarations only on-set and post-set callbacks hear.
        """
        self._parameter_set().add_pre_set(callback)

    def on_set_parameters(self, callback: Callable[[dict[str, Any]], str | None]) -> None:
        """Call `callback(values)` to ask whether parameters may be set so.

        It returns None, or why not: `return "too fast" if values.get("speed", 0) > 5 else None`. Whoever
        wants to set gets that text. Nothing is set yet, and others may still refuse, so it must change
        nothing. It is asked of declarations, too. A value of None is a parameter to be removed.
        """
        self._parameter_set().add_on_set(callback)

    def post_set_parameters(self, callback: Callable[[dict[str, Any]], object]) -> None:
        """Call `callback(values)` after parameters were set or declared, with what was."""
        self._parameter_set().add_post_set(callback)

    def remove_parameters_callback(self, callback: Callable[..., object]) -> None:
        """Call it no more. Raises ConfigurationError where it was not added."""
        self._parameter_set().remove(callback)

    # --- time

    def now(self) -> "Time":
        """The time, as stamps have it: a `builtin_interfaces.Time` since 1970.

        While the parameter `use_sim_time` is true it is the simulation's, from the topic /clock; 0 until its
        first message.
        """
        from bus.msg.builtin_interfaces import Time

        sec, nanosec = divmod(self._clock.now_ns(), _S)
        return Time(sec=sec, nanosec=nanosec)

    def create_rate(self, hz: float) -> Rate:
        """A rate of `hz` per second to sleep by in a loop; see `Rate`. It follows `use_sim_time`, too.

        Raises ConfigurationError for no rate.
        """
        self._opened()
        return Rate(hz, self._clock)

    # --- for Node

    def _read_parameters(self, arguments: Arguments) -> None:
        """What the command line says of this node's. Raises CommandLineError, as for a broken file."""
        self._overrides: dict[str, Any] = {}
        self._clock = Clock(self.full_name)
        self._parameters: ParameterSet | None = None
        self._server: ParameterServer | None = None
        self._time_source: TimeSource | None = None
        self._starting: asyncio.Task[None] | None = None
        self._has_time = False
        if arguments.parameters and self._takes_parameters:
            from bus.parameters import file

            try:
                sections = file.load(arguments.parameters)
            except ConfigurationError as error:
                raise CommandLineError(str(error)) from None
            self._overrides = file.overrides(sections, self.full_name)

    async def _open_parameters(self) -> None:
        self._has_time = True
        if self._overrides:
            await self._serve_parameters()
        if self._parameters is not None:
            self._follow_time(self._parameters.below("").get(_USE_SIM_TIME))
        if self._time_source is not None:
            await self._time_source.settled()

    def _close_parameters(self) -> None:
        """Services and subscriptions are closed with all other endpoints."""
        if self._starting is not None:
            self._starting.cancel()
        if self._time_source is not None:
            self._time_source.close()
        self._clock.close()
        self._clock = Clock(self.full_name)  # for a node that is opened again
        self._starting = self._server = self._time_source = None
        self._has_time = False

    # --- inside

    def _parameter_set(self) -> "ParameterSet":
        if self._parameters is None:
            from bus.parameters.store import ParameterSet

            self._parameters = ParameterSet(
                self.full_name, self._overrides, {_USE_SIM_TIME: False}, self._tell_parameters
            )
        return self._parameters

    async def _serve_parameters(self) -> None:
        """Begin, at the first declaration; one that is cancelled leaves that to go on for the others."""
        self._opened()
        if self._server is not None:
            return
        if self._starting is None:
            self._starting = asyncio.create_task(self._start_parameters(), name="serving parameters")
            self._starting.add_done_callback(self._end_start)
        starting = self._starting
        await asyncio.wait([starting])
        if starting.cancelled():
            raise ConnectionClosed(f"node {self.full_name} is closed")
        starting.result()

    def _end_start(self, starting: "asyncio.Task[None]") -> None:
        if self._starting is starting:
            self._starting = None
        if not starting.cancelled():
            starting.exception()  # is for those that wait; there may be none any more

    async def _start_parameters(self) -> None:
        from bus.parameters.server import EVENTS_TOPIC, ParameterServer, event_class

        events: Publisher[Any] | None = None
        try:
            # Each node has one and few say much: no ring is worth its memory.
            events = await self._create_publisher(
                event_class(), EVENTS_TOPIC, parameter_events, by_socket=True
            )
        except AccessDenied as denied:
            self._logger.warning(f"changes of parameters are told to nobody: {denied}")
        server = ParameterServer(self, self._parameter_set(), self._clock, events)
        await server.open(self._logger)
        self._server = server

    def _tell_parameters(self, change: "Change[Any]") -> None:
        if self._server is not None:
            self._server.tell(change)
        for one in (*change.new, *change.changed):
            if one.name == _USE_SIM_TIME:
                self._follow_time(one.value)

    def _follow_time(self, use_sim_time: object) -> None:
        is_simulated = use_sim_time is True  # a program may have declared it with any type
        if self._time_source is None:
            if not is_simulated or not self._has_time:
                return
            from bus.parameters.time_source import TimeSource

            self._time_source = TimeSource(self._clock, self._logger, self._subscribe_to_clock)
        self._time_source.follow(is_simulated)

    def _subscribe_to_clock(self, callback: Callable[[Any], None]) -> "Awaitable[Subscription[Any]]":
        from bus.parameters.time_source import CLOCK_QOS, CLOCK_TOPIC
        from bus.types.classes import message_class

        clock_class = message_class("rosgraph_msgs/msg/Clock")
        return self.create_subscription(clock_class, CLOCK_TOPIC, CLOCK_QOS, callback)
