"""Errors of a bridge, with texts for the user."""

from bus.errors import BusError

__all__ = ["BridgeError", "NotCarried", "in_words"]


class BridgeError(BusError):
    """A bridge, a link or an endpoint is not possible. The text names the thing and the fault."""


class NotCarried(BridgeError):
    """The engine never carries such a thing. If the user should know, the engine has reported it."""


def in_words(error: Exception) -> str:
    """The text of an error: alone for our errors, with the type for any other, which is a bug in the
    bridge."""
    return str(error) if isinstance(error, BusError) else f"{type(error).__name__}: {error}"
