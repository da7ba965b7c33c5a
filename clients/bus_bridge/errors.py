"""Errors of a bridge. Their texts are for the user."""

from bus.errors import BusError

__all__ = ["BridgeError", "NotCarried", "in_words"]


class BridgeError(BusError):
    """A bridge, a link or one endpoint can't be had. The text names the thing and what is wrong with it."""


class NotCarried(BridgeError):
    """The engine carries no such thing at all. If the user should know, the engine has said so."""


def in_words(error: Exception) -> str:
    """An error of ours as its text says it, any other with its type: it is a fault of the bridge."""
    return str(error) if isinstance(error, BusError) else f"{type(error).__name__}: {error}"
