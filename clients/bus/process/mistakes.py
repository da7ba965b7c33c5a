"""Texts for common mistakes: one line each, which shows the right way.

Owns the texts for mistakes of programmers with experience of rclpy, plain asyncio or NumPy. Only needed after
mistakes: import it late.
"""

import asyncio
import sys
from typing import Any

from bus.errors import LocalProtocolError, MessageTypeError

__all__ = [
    "array_field",
    "nested_run",
    "no_coroutine",
    "no_message_class",
    "other_loop",
    "plain_with",
    "wrong_open",
]


def no_message_class(what: Any) -> MessageTypeError:
    """The error for a message type that is no message class."""
    if not isinstance(what, type):
        how = "one is derived from msgspec.Struct"
        if isinstance(what, str):
            how = "give the class itself, as bus.msg.std_msgs.String"
        elif hasattr(type(what), "__struct_fields__"):
            how = f"give its class, {type(what).__name__}"
        return MessageTypeError(f"{what!r:.80} is no message class: {how}")
    name = f"{what.__module__}.{what.__qualname__}"
    if hasattr(what, "__dataclass_fields__"):
        return MessageTypeError(
            f"{name} is no message class, but a dataclass: derive it from msgspec.Struct, without @dataclass"
        )
    if hasattr(what, "Request") and hasattr(what, "Response"):
        return MessageTypeError(
            f"{name} is no message class, but a service: create_service and create_client take it"
        )
    return MessageTypeError(f"{name} is no message class: one is derived from msgspec.Struct")


def array_field(owner: str, field: str, cls: type) -> MessageTypeError:
    """The error for a field declared as an array or scalar of NumPy or a similar package: it can't be
    decoded."""
    name = f"{cls.__module__}.{cls.__qualname__}"
    if any(base.__module__ == "numpy" and base.__qualname__ == "generic" for base in cls.__mro__):
        use = "declare it as int or float, or as one of bus.msg's (uint8, float32, ...)"
    else:
        use = (
            "declare it as bytes (of uint8) or list[float], which take arrays as they are, or use "
            "bus.msg.sensor_msgs.Image"
        )
    return MessageTypeError(f"{owner}: field '{field}' is a {name}, which no subscription can decode: {use}")


def no_coroutine(main: Any) -> TypeError:
    """The error for an argument of `bus.run` that is no coroutine."""
    if callable(main):
        name = getattr(main, "__name__", "main")
        return TypeError(f"bus.run takes a coroutine: write bus.run({name}()), not bus.run({name})")
    return TypeError(f"bus.run takes a coroutine, as in bus.run(main()), not {main!r:.80}")


def nested_run() -> RuntimeError:
    """The error for a call of `bus.run` while an event loop runs."""
    return RuntimeError(
        "bus.run starts an event loop, but one is running here already: write await main(), in Jupyter too"
    )


def plain_with(name: str) -> TypeError:
    """The error for a node used with `with` instead of `async with`."""
    return TypeError(
        f"write async with bus.Node({name!r}) as node, in async def main(); or, in a script without asyncio, "
        f"with bus.connect({name!r}) as node"
    )


def wrong_open(name: str, *, is_open: bool) -> LocalProtocolError:
    """The error for a node that is opened twice, or without a running event loop of asyncio."""
    if is_open:
        return LocalProtocolError(f"node {name} is open already: async with opens it, too")
    if _is_trio():
        return LocalProtocolError(
            "a node needs asyncio's event loop, but trio's is running here: "
            "write await trio.to_thread.run_sync(lambda: bus.run(main()))"
        )
    return LocalProtocolError(
        "a node needs a running event loop: open it in async def main(): bus.run(main())"
    )


def other_loop(what: str, loop: asyncio.AbstractEventLoop) -> LocalProtocolError:
    """The error for the use of a node outside the event loop that opened it."""
    if loop.is_closed():
        return LocalProtocolError(
            f"{what} belongs to an event loop that has ended: open a node in the main() that uses it"
        )
    return LocalProtocolError(
        f"{what} belongs to another event loop than the one here: open a node in each, or call "
        "asyncio.run_coroutine_threadsafe(..., loop)"
    )


def _is_trio() -> bool:
    trio = sys.modules.get("trio")
    return trio is not None and bool(trio.lowlevel.in_trio_run())
