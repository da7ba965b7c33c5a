"""The state of one connection, the same rules for both ends: Hello first, once, in a version we speak.

    state     a Hello comes   another frame comes
    NEW       OPEN            (error)
    OPEN      (error)         OPEN

Bytes in, messages and runs out; no I/O. After an error the session is CLOSED and gives nothing more.
"""

from collections.abc import Iterable, Iterator
from enum import Enum, auto
from typing import Any

from bus.errors import RemoteProtocolError
from bus.wire.framing import FrameReader
from bus.wire.layout import (
    MAX_CONTROL_BYTES,
    MAX_MESSAGE_BYTES,
    MAX_SNAPSHOT_BYTES,
    RECORD_HEAD_BYTES,
    RUN_BYTES,
    VERSION,
)
from bus.wire.messages import Hello, from_broker, from_client
from bus.wire.runs import Run


class Role(Enum):
    """Which end of the connection we are."""

    CLIENT = auto()
    BROKER = auto()


class State(Enum):
    NEW = auto()
    OPEN = auto()
    CLOSED = auto()


_AFTER_HELLO = {State.NEW: State.OPEN}
_AFTER_OTHER = {State.OPEN: State.OPEN}
_WHEN = {State.NEW: "before Hello", State.OPEN: "a second time", State.CLOSED: "after an error"}


class Session:
    """Turns the bytes of a peer into messages (`bus.wire.messages`) and runs.

    `max_message_bytes` bounds an encoded message; a run may have others before it (`RUN_BYTES`).
    """

    def __init__(self, role: Role, *, max_message_bytes: int = MAX_MESSAGE_BYTES) -> None:
        self.state = State.NEW
        self.reader = FrameReader(
            max_control_bytes=MAX_CONTROL_BYTES if role is Role.BROKER else MAX_SNAPSHOT_BYTES,
            max_data_bytes=RUN_BYTES + RECORD_HEAD_BYTES + max_message_bytes,
        )
        self.peer: Hello | None = None
        self._decode = (from_client if role is Role.BROKER else from_broker).decode

    def received(self, count: int) -> Iterable[Any]:
        """What came with the `count` bytes now in the reader's buffer, in order.

        Iterating raises RemoteProtocolError where the peer broke a rule, after all that came before.
        """
        frames = self.reader.received(count)
        if (
            self.state is State.OPEN
            and len(frames) == 1
            and frames[0].__class__ is Run
            and self.reader.fault is None
        ):
            return frames  # the common case at a moderate rate, without a generator's cost
        return self._interpret(frames)

    def _interpret(self, frames: list[bytes | Run]) -> Iterator[Any]:
        try:
            for frame in frames:
                if isinstance(frame, Run):
                    self._step(_AFTER_OTHER, "a data frame")
                    yield frame
                else:
                    message = self._decode(frame)
                    if message.__class__ is Hello:
                        self._step(_AFTER_HELLO, "a Hello")
                        self._check(message)
                    else:
                        self._step(_AFTER_OTHER, f"a {type(message).__name__}")
                    yield message
            if self.reader.fault is not None:
                raise self.reader.fault
        except RemoteProtocolError:
            self.state = State.CLOSED
            raise

    def _step(self, table: dict[State, State], what: str) -> None:
        try:
            self.state = table[self.state]
        except KeyError:
            raise RemoteProtocolError(f"{what} came {_WHEN[self.state]}") from None

    def _check(self, hello: Hello) -> None:
        if hello.version != VERSION:
            raise RemoteProtocolError(
                f"protocol version {hello.version} offered, this side speaks {VERSION}; "
                "the two programs have different versions of busd"
            )
        self.peer = hello
