"""The hash of a service's type, as ROS 2 computes it: from its request, response and event messages. Pure."""

from typing import Any, Final

from bus.types.hash import schema_hash
from bus_ros.cdr import Codec, schema_of_definition

__all__ = ["service_hash"]

_TIME: Final = "builtin_interfaces/msg/Time"
_INFO: Final = "service_msgs/msg/ServiceEventInfo"
_EVENT_TYPES: Final[dict[str, Any]] = {
    _TIME: {
        "fields": [{"name": "sec", "type": "int32"}, {"name": "nanosec", "type": "uint32"}],
        "array": True,
    },
    _INFO: {
        "fields": [
            {"name": "event_type", "type": "uint8"},
            {"name": "stamp", "type": _TIME},
            {"name": "client_gid", "type": ["bytes", 16, 16, "char"]},
            {"name": "sequence_number", "type": "int64"},
        ],
        "array": True,
    },
}


def service_hash(type_name: str, request: Codec, response: Codec) -> str:
    """RIHS01 of the service `type_name`, such as `std_srvs/srv/Trigger`, with these messages."""
    asked, answered, event = (f"{type_name}_{part}" for part in ("Request", "Response", "Event"))
    types: dict[str, Any] = {**_EVENT_TYPES}
    for codec, name in ((request, asked), (response, answered)):
        found = schema_of_definition(codec.type_name, codec.definition).description["types"]
        types |= {name if one == codec.type_name else one: type_ for one, type_ in found.items()}
    types[event] = _message(info=_INFO, request=["list", asked, 0, 1], response=["list", answered, 0, 1])
    types[type_name] = _message(request_message=asked, response_message=answered, event_message=event)
    return schema_hash({"root": type_name, "types": types})


def _message(**fields: Any) -> dict[str, Any]:
    return {"fields": [{"name": name, "type": type_} for name, type_ in fields.items()], "array": True}
