"""A peer with scripted messages: blocking, over a real socket, with the real wire and without any rules.

    with RawPeer(path) as peer:
        peer.hello()
        peer.write(b"...")              any bytes
        peer.send(m.Ping(number=1))     a message, or a message's bytes in a frame
        peer.carry(m.Share(), a, b)     a message with descriptors, whatever it announces
        peer.expect(m.Pong)
        peer.fault()                    the broker's last message, after which the connection must end

Knows nothing of the behaviour of a normal client; `declare` and the two helpers after it only save typing.
"""

import array
import select
import socket
import struct
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from bus.base.descriptor import Descriptor
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.types.support import type_support
from bus.wire import messages as m
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
    PROTOCOL_VERSION,
)
from bus.wire.session import Carried, Role, Session
from conftest import WAIT_S
from feeding import frame_record

T = TypeVar("T")

STRING = type_support(String)
HELLO = m.encode_frame(m.Hello(version=PROTOCOL_VERSION, program="raw peer"))
_gids = count(1)


def control(body: bytes) -> bytes:
    """A control frame with any body."""
    return FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body


def data(endpoint: int, body: bytes, *, first_seq: int = 1, count: int = 1) -> bytes:
    """A data frame with any body."""
    length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
    return DATA_HEAD.pack(length, DATA, 0, 0, endpoint, 0, first_seq, count, 0) + body


def text(value: str) -> bytes:
    """A record with a well-formed String message."""
    return frame_record(bytes(STRING.encode(String(data=value))), time.monotonic_ns())


class RawPeer:
    """A connection to the broker at `path`; close it, or use it as a context manager."""

    def __init__(self, path: Path, *, receive_buffer: int | None = None) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        if receive_buffer is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(WAIT_S)
        self.socket.connect(str(path))
        self.descriptors: tuple[Descriptor, ...] = ()
        """Descriptors received with the last message that announced some."""
        self._session = Session(Role.CLIENT)
        self._waiting: list[Any] = []
        self._requests = count(1)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self.socket.close()
        self._session.drop_descriptors()

    # --- out

    def write(self, raw: bytes) -> None:
        """Send bytes as they are; no error if the broker has closed the connection already."""
        try:
            self.socket.sendall(raw)
        except (BrokenPipeError, ConnectionResetError):
            pass

    def write_some(self, raw: bytes) -> int:
        """Send as much as the socket takes at once; returns how much."""
        try:
            return self.socket.send(raw, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return 0

    def send(self, *messages: m.Message) -> None:
        self.write(b"".join(map(m.encode_frame, messages)))

    def carry(self, message: m.Message, *descriptors: Descriptor) -> None:
        """Send a message with these descriptors; no error if the broker has closed the connection already."""
        try:
            numbers = [descriptor.fileno() for descriptor in descriptors]
            socket.send_fds(self.socket, [m.encode_frame(message)], numbers)
        except (BrokenPipeError, ConnectionResetError):
            pass

    def hello(self) -> Self:
        """Exchange Hellos."""
        self.write(HELLO)
        self.expect(m.Hello)
        return self

    # --- in

    @property
    def has_more(self) -> bool:
        """Whether there is received data that was not taken yet."""
        return bool(self._waiting or select.select([self.socket], [], [], 0)[0])

    def receive(self) -> Any:
        """The next message or run; None at the end of the stream. Raises TimeoutError."""
        while not self._waiting:
            try:
                size = self._read()
            except ConnectionResetError:
                size = 0
            if not size:
                return None
            self._waiting.extend(self._session.received(size))
        item = self._waiting.pop(0)
        if isinstance(item, Carried):
            item, self.descriptors = item
        return item

    def _read(self) -> int:
        """Read once, including descriptors."""
        buffers, space = [self._session.reader.get_buffer()], socket.CMSG_SPACE(8)
        size, ancillary, _, _ = self.socket.recvmsg_into(buffers, space, socket.MSG_CMSG_CLOEXEC)
        for _, _, numbers in ancillary:
            self._session.descriptors.append(tuple(map(Descriptor, array.array("i", numbers))))
        return size

    def until_end(self) -> Iterator[Any]:
        """Everything up to the end of the stream."""
        while (item := self.receive()) is not None:
            yield item

    def expect(self, kind: type[T]) -> T:
        """The next message of that kind; earlier ones are skipped."""
        for item in self.until_end():
            if isinstance(item, kind):
                return item
            assert not isinstance(item, m.Fault), item.text
        raise AssertionError(f"the broker closed the connection; no {kind} came")

    def fault(self) -> str:
        """The text with which the broker closes the connection; the connection must end after it."""
        *_, last = self.until_end()
        assert isinstance(last, m.Fault), f"the last word was {last}"
        return last.text

    def was_cut_off(self) -> bool:
        """Whether the stream ends without a last message, as for a peer that did not read."""
        return not any(isinstance(item, m.Fault) for item in self.until_end())

    def barrier(self) -> None:
        """Wait until the broker has handled everything sent before."""
        number = next(self._requests)
        self.send(m.Ping(number=number))
        while self.expect(m.Pong).number != number:
            pass

    # --- requests

    def request(self) -> int:
        """A number for a request."""
        return next(self._requests)

    def ask(self, message: m.Message) -> Any:
        """Send a request and return its answer, which may be Refused."""
        self.send(message)
        number = message.request  # type: ignore[attr-defined]
        for item in self.until_end():
            assert not isinstance(item, m.Fault), item.text
            if getattr(item, "request", None) == number:
                return item
        raise AssertionError("the broker closed the connection; no answer came")

    def node(self, name: str = "raw") -> int:
        """Declare a node and the type String; returns the node's id."""
        self.send(m.DeclareType(type_name=STRING.name, type_hash=STRING.hash))
        created: m.Created = self.ask(m.CreateNode(request=self.request(), name=name))
        return created.id

    def publisher(self, node: int, topic: str, **changes: Any) -> Any:
        """The answer to the declaration of a publisher; `changes` are other fields."""
        return self.ask(m.CreatePublisher(**self.endpoint_fields(node, topic, changes)))

    def subscription(self, node: int, topic: str, **changes: Any) -> Any:
        """The answer to the declaration of a subscription; `changes` are other fields."""
        return self.ask(m.CreateSubscription(**self.endpoint_fields(node, topic, changes)))

    def endpoint_fields(self, node: int, topic: str, changes: dict[str, Any]) -> dict[str, Any]:
        """The fields of a declaration."""
        return {
            "request": self.request(),
            "node": node,
            "topic": topic,
            "type_name": STRING.name,
            "type_hash": STRING.hash,
            "qos": QoSProfile(),
            "gid": struct.pack("<QQ", id(self), next(_gids)),
            **changes,
        }
