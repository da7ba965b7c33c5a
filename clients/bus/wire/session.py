"""The state of one connection, with the same rules for both ends: a Hello comes first, once, in our version.

    state     a Hello comes   another frame comes
    NEW       OPEN            (error)
    OPEN      (error)         OPEN

Bytes in, messages and runs out; no I/O. After an error the session is CLOSED and returns nothing more.

Descriptors come in batches, outside the stream of bytes: one batch for each frame with descriptors, in the
order of these frames. The session can only close them.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from enum import Enum, auto
from typing import Any, NamedTuple

from bus.base.descriptor import Descriptor
from bus.errors import RemoteProtocolError
from bus.wire.framing import FrameReader
from bus.wire.layout import (
    MAX_CONTROL_BYTES,
    MAX_MESSAGE_BYTES,
    MAX_SNAPSHOT_BYTES,
    PROTOCOL_VERSION,
    RECORD_HEAD_BYTES,
    RUN_BYTES,
)
from bus.wire.messages import Hello, Message, from_broker, from_client
from bus.wire.runs import Run


class Role(Enum):
    """This end's role in the connection."""

    CLIENT = auto()
    BROKER = auto()


class State(Enum):
    NEW = auto()
    OPEN = auto()
    CLOSED = auto()


_AFTER_HELLO = {State.NEW: State.OPEN}
_AFTER_OTHER = {State.OPEN: State.OPEN}
_WHEN = {State.NEW: "before Hello", State.OPEN: "a second time", State.CLOSED: "after an error"}


MAX_BATCHES = 16
"""Most batches of descriptors that may wait for their messages; an honest peer has one on the way."""


MISSING = "the descriptors did not arrive; are the limits reached?"
"""The error for a message that came without its descriptors."""


class Carried(NamedTuple):
    """A message that claims descriptors, and the received descriptors: all or none."""

    message: Message
    descriptors: tuple[Descriptor, ...]


class Session:
    """Turns the bytes of a peer into messages (`bus.wire.messages`) and runs.

    A message that claims descriptors is returned as a `Carried`. The caller appends the batch of a read to
    `descriptors` before it calls `received`; there the batch waits for its message. `max_message_bytes`
    bounds an encoded message; in a run, others may come before it (`RUN_BYTES`).
    """

    def __init__(self, role: Role, *, max_message_bytes: int = MAX_MESSAGE_BYTES) -> None:
        self.state = State.NEW
        self.reader = FrameReader(
            max_control_bytes=MAX_CONTROL_BYTES if role is Role.BROKER else MAX_SNAPSHOT_BYTES,
            max_data_bytes=RUN_BYTES + RECORD_HEAD_BYTES + max_message_bytes,
            is_broker=role is Role.BROKER,
        )
        self.peer: Hello | None = None
        self._role = role
        self.descriptors: deque[tuple[Descriptor, ...]] = deque()
        self._decode = (from_client if role is Role.BROKER else from_broker).decode

    def received(self, count: int) -> Iterable[Any]:
        """The messages and runs in the `count` new bytes of the reader's buffer, in order.

        The buffer is in use until the iteration has ended: read nothing into it before.
        Iterating raises RemoteProtocolError if the peer broke a rule, after all earlier messages.
        """
        if self.state is not State.OPEN or self.descriptors:
            self.reader.came(count)
        elif (run := self.reader.came_alone(count)) is not None:
            return (run,)  # the common case at a moderate rate, without a generator's cost
        return self.items()

    def items(self) -> Iterator[Any]:
        """As `received`, for all bytes that were not taken from the reader's front."""
        return self._interpret(self.reader.cut())

    def open(self, hello: Hello) -> None:
        """Open the session with the peer's Hello, which was read before (`bus.wire.greeting`)."""
        self.state, self.peer = State.OPEN, hello

    def allow(self, max_message_bytes: int) -> None:
        """Raise the limit of messages, if this one is higher."""
        most = RUN_BYTES + RECORD_HEAD_BYTES + max_message_bytes
        self.reader.max_data_bytes = max(self.reader.max_data_bytes, most)

    def drop_descriptors(self) -> None:
        """Close the descriptors that wait for their messages."""
        while self.descriptors:
            _close(self.descriptors.popleft())

    def _interpret(self, frames: list[bytes | Run]) -> Iterator[Any]:
        try:
            while frames:
                for frame in frames:
                    if isinstance(frame, Run):
                        if self.state is not State.OPEN:
                            self._step(_AFTER_OTHER, "a data frame")
                        yield frame
                    else:
                        message = self._decode(frame)
                        if message.__class__ is Hello:
                            self._step(_AFTER_HELLO, "a Hello")
                            check_version(message, self._role)
                            self.peer = message
                        elif self.state is not State.OPEN:
                            self._step(_AFTER_OTHER, f"a {type(message).__name__}")
                        claimed: int = getattr(message, "descriptors", 0)
                        yield Carried(message, self._claim(claimed)) if claimed else message
                frames = self.reader.cut()
            if len(self.descriptors) > MAX_BATCHES:
                raise RemoteProtocolError("descriptors that no message claims")
            if self.reader.fault is not None:
                raise self.reader.fault
        except RemoteProtocolError:
            self.state = State.CLOSED
            raise

    def _claim(self, count: int) -> tuple[Descriptor, ...]:
        batch = self.descriptors.popleft() if self.descriptors else ()
        if len(batch) == count:
            return batch
        _close(batch)
        return ()

    def _step(self, table: dict[State, State], what: str) -> None:
        try:
            self.state = table[self.state]
        except KeyError:
            raise RemoteProtocolError(f"{what} came {_WHEN[self.state]}") from None


def check_version(hello: Hello, role: Role) -> None:
    """Raise RemoteProtocolError if the other side speaks another version; our `role` decides the remedy."""
    if hello.version != PROTOCOL_VERSION:
        is_theirs_older = hello.version < PROTOCOL_VERSION
        if (role is Role.CLIENT) is is_theirs_older:
            remedy = "the busd that runs is older: update it, then bus daemon stop"
        else:
            remedy = "the program has an older busd than runs: update the one that it imports"
        raise RemoteProtocolError(
            f"protocol version {hello.version} offered, this side speaks {PROTOCOL_VERSION}; {remedy}"
        )


def _close(batch: tuple[Descriptor, ...]) -> None:
    for descriptor in batch:
        descriptor.close()
