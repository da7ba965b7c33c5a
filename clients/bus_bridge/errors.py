"""What can be wrong with a bridge, as errors whose text is for the user."""

from bus.errors import BusError

__all__ = ["BridgeError"]


class BridgeError(BusError):
    """A bridge, a link or one endpoint can't be had. The text names the thing and what is wrong with it."""
