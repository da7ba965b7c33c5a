"""Control messages out of the bodies of frames.

Owns the refusal of what is none; must not know the messages.
"""

from typing import Any

import msgspec

from bus.errors import RemoteProtocolError


class Decoder:
    """Decodes the control messages that one role may send (`union`); one for each role is enough."""

    def __init__(self, union: Any) -> None:
        self._decode = msgspec.msgpack.Decoder(union).decode

    def decode(self, body: bytes) -> Any:
        """Raises RemoteProtocolError, naming the field, where `body` is no message of that role."""
        try:
            return self._decode(body)
        except (ValueError, RecursionError) as error:  # msgspec's errors and bad UTF-8 are ValueErrors
            raise RemoteProtocolError(f"control message not understood: {error}") from None
