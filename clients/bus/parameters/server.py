"""The interface of a native node's parameters for other programs: six services, and the topic
/parameter_events.

Owns: the conversion of requests to calls of a ParameterSet, of results to responses, of changes to events.
Must not know: the transport of services. A remote program's mistake becomes an answer to it, and never an
error here.
"""

from collections.abc import Callable, Iterable
from contextlib import AsyncExitStack
from typing import Any, Final

from bus.clock import Clock
from bus.errors import AccessDenied, ConnectionClosed, PayloadTooLarge
from bus.parameters.messages import (
    SERVICES,
    descriptor_message,
    event_message,
    python_value,
    value_message,
)
from bus.parameters.owner import ParameterOwner
from bus.parameters.parameter_set import Parameter, ParameterSet
from bus.parameters.store import Change, Outcome
from bus.parameters.values import ParameterType
from bus.publisher import Publisher
from bus.types.classes import message_class, service_class

__all__ = ["EVENTS_TOPIC", "ParameterServer", "event_class"]

EVENTS_TOPIC: Final = "/parameter_events"

_NS_PER_S = 1_000_000_000


def event_class() -> Any:
    """The class of rcl_interfaces/msg/ParameterEvent."""
    return _message("ParameterEvent")


class ParameterServer:
    """Serves the `parameters` of `node`, and publishes their changes by `events`, unless that is None."""

    def __init__(
        self, node: ParameterOwner, parameters: ParameterSet, clock: Clock, events: Publisher[Any] | None
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._clock = clock
        self._events = events

    async def open(self) -> None:
        """Create the services. If access rules forbid them, log that, and continue without them.

        After another error, or a cancellation, none is left.
        """
        callbacks: dict[str, Callable[[Any], Any]] = {
            "DescribeParameters": self._describe,
            "GetParameterTypes": self._get_types,
            "GetParameters": self._get,
            "ListParameters": self._list,
            "SetParameters": self._set,
            "SetParametersAtomically": self._set_atomically,
        }
        async with AsyncExitStack() as undoing:
            try:
                for name, topic in SERVICES.items():
                    service = await self._node.create_service(
                        service_class(f"rcl_interfaces/srv/{name}"),
                        f"{self._node.full_name}/{topic}",
                        callbacks[name],
                    )
                    undoing.push_async_callback(service.close)
            except AccessDenied as denied:
                self._node.get_logger().warning(
                    f"nobody else can read or set this node's parameters: {denied}"
                )
            undoing.pop_all()

    def publish_event(self, change: Change[Parameter]) -> None:
        """Publish a ParameterEvent."""
        if self._events is None:
            return
        event = event_message(_message, self._node.full_name, change)
        event.stamp.sec, event.stamp.nanosec = divmod(self._clock.now_ns(), _NS_PER_S)
        try:
            self._events.publish(event)
        except ConnectionClosed:
            pass  # set after the node was closed: the event can't be published
        except PayloadTooLarge as error:  # the value is set anyway, perhaps by another program
            self._node.get_logger().warning(f"a change of parameters is told to nobody: {error}")

    # --- one method for each service

    def _describe(self, request: Any) -> Any:
        found = []
        for name in request.names:
            if name not in self._parameters:
                found.append(_message("ParameterDescriptor")())
                continue
            declared = self._parameters.find(name)
            found.append(descriptor_message(_message, name, declared.rules, *declared.description))
        return _response("DescribeParameters", descriptors=found)

    def _get_types(self, request: Any) -> Any:
        types = [0 if one is None else int(one.type_) for one in self._found(request.names)]
        return _response("GetParameterTypes", types=bytes(types))

    def _get(self, request: Any) -> Any:
        values = [
            value_message(_message, ParameterType.NOT_SET if one is None else one.type_, one and one.value)
            for one in self._found(request.names)
        ]
        return _response("GetParameters", values=values)

    def _list(self, request: Any) -> Any:
        names, prefixes = self._parameters.find_below(request.prefixes, request.depth)
        result = _message("ListParametersResult")(names=names, prefixes=prefixes)
        return _response("ListParameters", result=result)

    def _set(self, request: Any) -> Any:
        results = [self._try_to_set([one]) for one in request.parameters]
        return _response("SetParameters", results=results)

    def _set_atomically(self, request: Any) -> Any:
        return _response("SetParametersAtomically", result=self._try_to_set(request.parameters))

    def _found(self, names: Iterable[str]) -> list[Parameter | None]:
        return [self._parameters.find(name).parameter if name in self._parameters else None for name in names]

    def _try_to_set(self, messages: Iterable[Any]) -> Any:
        try:
            wanted = [_parameter(message) for message in messages]
        except ValueError as error:
            outcome = Outcome(False, str(error))
        else:
            outcome = self._parameters.change(wanted)
        return _message("SetParametersResult")(**outcome._asdict())


def _parameter(message: Any) -> Parameter:
    """Read a message. Raises ValueError for a type that does not exist."""
    value = python_value(message.value)
    return Parameter(message.name, ParameterType(message.value.type), value)


def _message(name: str) -> Any:
    return message_class(f"rcl_interfaces/msg/{name}")


def _response(service: str, **fields: Any) -> Any:
    kind: Any = service_class(f"rcl_interfaces/srv/{service}")
    return kind.Response(**fields)
