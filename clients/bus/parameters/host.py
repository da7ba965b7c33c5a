"""The methods of a node for parameters and time; `bus.parameters.served` does the work."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, overload

from bus.clock import Rate
from bus.parameters.served import ServedParameters

if TYPE_CHECKING:
    from bus.msg.builtin_interfaces import Time

__all__ = ["ParameterHost"]

Value: TypeAlias = bool | int | float | str | bytes | list[bool] | list[int] | list[float] | list[str]
"""The types of a parameter's value."""
V = TypeVar("V", bound=Value)

_NS_PER_S = 1_000_000_000


class ParameterHost:
    """Base class of Node."""

    _served: ServedParameters
    """Set by the node."""

    _takes_parameters = True
    """False in the facade's node, which takes the command line's parameters itself."""

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
        """Declare a parameter and return its value: from the command line (`-p name:=value`,
        `--params-file`), or else `default`.

            rate = await node.declare_parameter("rate", 10.0, range=(1, 100), description="Hz")

        A value is a bool, int, float, str, bytes, or a list of bool, int, float or str.

        - `default`: fixes the parameter's type.
        - `type`: the type (`float`, `list[str]`) if `default` is absent or an empty list. Without a default
          the value is None until it is set.
        - `dynamic_typing`: the type may change, and other programs may delete the parameter.
        - `range`: (lowest, highest) or (lowest, highest, step), both ends included, for an int or a float.
        - `read_only`: the parameter keeps its declared value.
        - `description` and `additional_constraints` are for people: `bus param describe` shows them.

        The first declaration makes the six services by which other programs see the node's parameters, and
        the publisher of /parameter_events. Raises ParameterError if the name, value or range is not allowed
        or a callback refuses; CommandLineError if that value is from the command line. After a cancellation
        the parameter is not declared.
        """
        from bus.parameters.parameter_set import Description

        return await self._served.declare(
            name,
            default,
            type_=type,
            description=Description(description, additional_constraints),
            limits=range,
            is_read_only=read_only,
            is_dynamic=dynamic_typing,
        )

    def undeclare_parameter(self, name: str) -> None:
        """Remove a parameter. Raises ParameterError if it is not declared, or read-only."""
        self._served.parameters.undeclare(name)

    def has_parameter(self, name: str) -> bool:
        """Whether the parameter is declared."""
        return name in self._served.parameters

    def get_parameter(self, name: str) -> Any:
        """The value of a parameter, with the type that it was declared with; lists are copies.

        Raises ParameterError if it is not declared, or has no value yet.
        """
        return self._served.parameters.get(name)

    def get_parameters(self, prefix: str = "") -> dict[str, Any]:
        """Values by name, of all parameters that have one.

        With `prefix` "arm", the values of `arm.length`, `arm.joint.gain` and so on, as `length` and
        `joint.gain`.
        """
        return self._served.parameters.below(prefix)

    def set_parameter(self, name: str, value: Any) -> None:
        """Set one parameter, as other programs can: the callbacks are asked, the change is published.

        Raises ParameterError if it is not declared, or the value is refused; then nothing has changed.
        """
        self._served.parameters.set({name: value})

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Set several parameters, all or none. Raises as `set_parameter`."""
        self._served.parameters.set(values)

    def pre_set_parameters(self, callback: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        """Call `callback(values)` before parameters are set; it returns a dict of the values to set instead.

        `values` is the content of one change, by name. All callbacks for parameters are plain functions. An
        exception in one comes out of the call that sets, or out of the node if another program sets. The
        callback added last is called first. Declarations call only on-set and post-set callbacks.
        """
        self._served.parameters.add_pre_set(callback)

    def on_set_parameters(self, callback: Callable[[dict[str, Any]], str | None]) -> None:
        """Call `callback(values)` to ask whether parameters may be set to these values.

        It returns None, or a reason to refuse: `return "too fast" if values.get("speed", 0) > 5 else None`.
        The caller gets that text. Nothing is set yet, and other callbacks may still refuse, so it must change
        nothing. Declarations ask it, too. A value of None is a parameter to be removed.
        """
        self._served.parameters.add_on_set(callback)

    def post_set_parameters(self, callback: Callable[[dict[str, Any]], object]) -> None:
        """Call `callback(values)` after parameters were set or declared, with their values."""
        self._served.parameters.add_post_set(callback)

    def remove_parameters_callback(self, callback: Callable[..., object]) -> None:
        """Remove a parameter callback. Raises ConfigurationError if it was not added."""
        self._served.parameters.remove(callback)

    # --- time

    def now(self) -> "Time":
        """The current time for stamps: a `builtin_interfaces.Time` since 1970.

        While the parameter `use_sim_time` is true, it is simulated time from the topic /clock, and 0 until
        the first message there.
        """
        from bus.msg.builtin_interfaces import Time

        sec, nanosec = divmod(self._served.clock.now_ns(), _NS_PER_S)
        return Time(sec=sec, nanosec=nanosec)

    def create_rate(self, hz: float) -> Rate:
        """A rate of `hz` per second for the sleep in a loop; see `Rate`. It follows `use_sim_time`, too.

        Raises ConfigurationError if `hz` is not a valid rate.
        """
        return self._served.create_rate(hz)
