"""A small blocking client of busd, for single questions: needs no event loop, and blocks none for long.

Owns the connection, its Hello, and the wait for one answer at a time. Must not know: nodes, declarations.
"""

import os
import socket
import struct
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from msgspec import structs

from bus.base.version import RELEASE
from bus.errors import BrokerUnavailable, ConfigurationError, ConnectionClosed, RemoteProtocolError
from bus.graph import Graph, graph_of
from bus.link.reach import TELL_S, NotNow, Patience, no_answer, no_answer_yet, program_name, try_to_connect
from bus.wire import messages as m
from bus.wire.answers import expect
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.session import Role, Session

__all__ = ["ANSWER_S", "NotRunning", "Query"]

A = TypeVar("A", bound=m.Message)

ANSWER_S = 10.0
_CREDENTIALS: Final = struct.Struct("3i")
"""`struct ucred`: process id, user, group."""


class NotRunning(BrokerUnavailable):
    """No broker listens, and the caller did not allow to start one."""


class Query:
    """A connection to the broker at `path`. With `may_start`, starts a broker if none runs.

    Each wait lasts `answer_s` seconds at most. `on_slow` gets a text if an answer takes TELL_S. Raises
    BrokerUnavailable; without `may_start` and without a broker, it raises NotRunning, a subclass.
    """

    def __init__(
        self,
        path: Path,
        *,
        may_start: bool = True,
        answer_s: float = ANSWER_S,
        program: str | None = None,
        on_slow: Callable[[str], object] | None = None,
    ) -> None:
        self.path = path
        self._program = program or program_name()
        self._on_slow = on_slow
        self._answer_s = answer_s
        self._session = Session(Role.CLIENT)
        self._sender = 0
        self._items: Iterator[Any] = iter(())
        self._numbers = count(1)
        patience = Patience(answer_s)
        while True:
            try:
                self._socket = _connect(path) or _start(path, patience, may_start=may_start)
                self.broker: m.Hello = self._greet()
                """Its Hello. `pid` is as this process sees it: 0 if a PID namespace hides busd."""
                return
            except NotNow as error:
                pause_s = patience.pause_s(str(error), error.longest_pause_s)
            time.sleep(pause_s)

    def request(self, make: Callable[[int], m.Message], kind: type[A]) -> A:
        """Send the message that `make` returns for a request number; returns the answer, a `kind`.

        Raises ConfigurationError, QuotaExceeded or AccessDenied if the broker refuses; RemoteProtocolError if
        the answer has another kind; ConnectionClosed if the broker ends.
        """
        number = next(self._numbers)
        self._send(make(number))
        while True:
            message = self._receive()
            if getattr(message, "request", None) == number:
                return expect(message, kind)

    def graph(self, *, statistics: bool = False) -> Graph:
        """The current graph."""
        return graph_of(
            self.request(lambda number: m.GetGraph(request=number, statistics=statistics), m.GraphSnapshot)
        )

    def description(self, type_name: str, type_hash: str) -> bytes | None:
        """The encoded description of a type on the bus; None if no endpoint has the type any more."""
        try:
            return self.request(
                lambda number: m.GetType(request=number, type_name=type_name, type_hash=type_hash),
                m.TypeDescription,
            ).schema
        except ConfigurationError:
            return None

    def charges(self) -> m.Peers | None:
        """Resources that busd holds for processes and users; None if this busd does not know the request."""
        if not self.broker.release:  # such an old busd would close the connection
            return None
        return self.request(lambda number: m.GetPeers(request=number), m.Peers)

    def wait_for_end(self) -> None:
        """Wait until the broker has closed the connection. Raises BrokerUnavailable if it does not."""
        try:
            while True:
                self._receive()
        except BrokerUnavailable:
            raise
        except ConnectionClosed:
            return

    def close(self) -> None:
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _greet(self) -> m.Hello:
        """Exchange Hellos. Raises NotNow if the broker closes the connection for a temporary reason."""
        self._socket.settimeout(self._answer_s)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._session, self._items = Session(Role.CLIENT), iter(())
        try:
            self._send(
                m.Hello(version=PROTOCOL_VERSION, pid=os.getpid(), program=self._program, release=RELEASE)
            )
            hello: m.Hello = structs.replace(self._receive(), pid=self._sender)
            behind = list(self._items)
            self._items = iter(behind)
            if behind and isinstance(behind[0], m.Fault) and behind[0].again:
                raise NotNow(f"busd at {self.path} refused this process: {behind[0].text}")
            return hello
        except BrokerUnavailable:
            self.close()
            raise
        except ConnectionClosed as error:  # for example, a broker ended with connections in its backlog
            self.close()
            raise NotNow(str(error)) from None
        except BaseException:
            self.close()
            raise

    def _send(self, message: m.Message) -> None:
        try:
            self._socket.sendall(m.encode_frame(message))
        except (BrokenPipeError, ConnectionResetError):
            pass  # busd is gone, but its last message, with the reason, can still be read
        except OSError as error:
            raise ConnectionClosed(f"lost busd at {self.path}: {error.strerror or error}") from None

    def _receive(self) -> Any:
        while (message := next(self._items, None)) is None:
            try:
                size = self._read()
            except TimeoutError:
                raise BrokerUnavailable(no_answer(self.path, self._answer_s)) from None
            except OSError as error:
                raise ConnectionClosed(f"lost busd at {self.path}: {error.strerror or error}") from None
            if not size:
                raise ConnectionClosed(f"busd at {self.path} closed the connection")
            self._items = iter(self._session.received(size))
        if isinstance(message, m.Fault):
            raise RemoteProtocolError(message.text)
        return message

    def _read(self) -> int:
        """Wait for bytes. After TELL_S, say once that it waits. Raises TimeoutError."""
        buffer = self._session.reader.get_buffer()
        if self._answer_s <= TELL_S:
            return self._read_once(buffer)
        self._socket.settimeout(TELL_S)
        try:
            return self._read_once(buffer)
        except TimeoutError:
            if self._on_slow is not None:
                self._on_slow(no_answer_yet(self.path))
            self._socket.settimeout(self._answer_s - TELL_S)
            return self._read_once(buffer)
        finally:
            self._socket.settimeout(self._answer_s)

    def _read_once(self, buffer: memoryview) -> int:
        """Read bytes, and note the process that sent them.

        The kernel knows it. busd knows only the number in its own PID namespace, and a socket's maker may be
        systemd.
        """
        size, ancillary, _, _ = self._socket.recvmsg_into([buffer], socket.CMSG_SPACE(_CREDENTIALS.size))
        for level, kind, data in ancillary:
            if (level, kind, len(data)) == (socket.SOL_SOCKET, socket.SCM_CREDENTIALS, _CREDENTIALS.size):
                self._sender, _, _ = _CREDENTIALS.unpack(data)
        return size


def _connect(path: Path) -> socket.socket | None:
    """Connect to the broker; returns None if no broker listens."""
    try:
        return try_to_connect(path)
    except (FileNotFoundError, ConnectionRefusedError):
        return None


def _start(path: Path, patience: Patience, *, may_start: bool) -> socket.socket:
    if not may_start:
        raise NotRunning(f"no busd listens on {path}")
    import asyncio

    from bus.link.reach import open_socket

    return asyncio.run(open_socket(path, patience))
