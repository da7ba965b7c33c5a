"""ROS 2's ready-made services, one module a package: `from bus.srv.example_interfaces import AddTwoInts`.

Owns: the base class of a service's definition, and the list of packages. Must not know: topics, the wire.

    import bus
    from bus.msg import Message, float64

    class Scale(bus.Service):
        class Request(Message, kw_only=True):
            value: float64 = 0.0

        class Response(Message, kw_only=True):
            value: float64 = 0.0
"""

from sys import _getframe
from typing import Any, ClassVar, Final

__all__ = ["PACKAGES", "Service", "make_service"]

PACKAGES: Final = ("example_interfaces", "std_srvs")


def __getattr__(name: str) -> Any:
    if name in PACKAGES:
        from importlib import import_module

        return import_module(f"bus.srv.{name}")
    # Names that tools search, and modules that `from ... import` is about to import, are no mistakes.
    if name.startswith("_") or _getframe(1).f_code.co_name == "_handle_fromlist":
        raise AttributeError(f"module 'bus.srv' has no attribute {name!r}")
    from bus.base.missing_names import missing_name

    raise missing_name("bus.srv", name, (*PACKAGES, *__all__))


class Service:
    """Base of a service's definition: two message classes, `Request` and `Response`, within it.

    `__type_name__` is `<package>/srv/<Class>` for the classes under bus.srv, `local/srv/<Class>` elsewhere,
    or the name that the class itself sets. It is never instantiated: see `Node.create_service` and
    `Node.create_client`.

        class Scale(bus.Service):
            class Request(Message, kw_only=True):
                value: float64 = 0.0

            class Response(Message, kw_only=True):
                value: float64 = 0.0
    """

    __type_name__: ClassVar[str]
    Request: ClassVar[type[Any]]
    """The message class of requests."""
    Response: ClassVar[type[Any]]
    """The message class of responses, made without arguments for callbacks that fill one."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "__type_name__" not in cls.__dict__:
            package = cls.__module__.split(".")[2] if cls.__module__.startswith("bus.srv.") else "local"
            cls.__type_name__ = f"{package}/srv/{cls.__name__}"
        for part in ("Request", "Response"):
            message = cls.__dict__.get(part)
            if message is not None and message.__qualname__ == f"{cls.__qualname__}.{part}":
                message.__type_name__ = f"{cls.__type_name__}_{part}"
                message.__name__ = f"{cls.__name__}_{part}"  # its name in texts of ROS 2


def make_service(name: str, request: type[Any], response: type[Any]) -> type[Service]:
    """Make the class of service `name` (`demo/srv/Scale`) with these two message classes."""
    contents = {"__type_name__": name, "Request": request, "Response": response}
    return type(name.rpartition("/")[2], (Service,), contents)
