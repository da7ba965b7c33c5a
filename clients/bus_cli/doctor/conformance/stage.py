"""The stage of a story: a socket, the client's process, and its connections one after the other.

    async with Stage(["./client"], Path("/tmp/x"), wait_s=10) as stage:
        peer = await stage.meet()
        await peer.until(lambda: peer.talk.nodes, "it created no node")

Every wait ends with Wrong if the client breaks a rule, closes the connection, or takes too long.
"""

import asyncio
import os
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic_ns
from types import TracebackType
from typing import Any, Self, TypeVar

import msgspec

from bus.errors import RemoteProtocolError
from bus.wire import messages as m
from bus.wire.layout import CONTROL, FRAME_HEAD, FRAME_HEAD_BYTES, LENGTH_BYTES, PROTOCOL_VERSION
from bus.wire.session import Carried, Role, Session
from bus_cli.doctor.conformance.client import Client
from bus_cli.doctor.conformance.conversation import USUAL, Conversation, Terms, Wrong

__all__ = ["Ended", "Peer", "Stage"]

T = TypeVar("T")

LEASE_S = 2.0
_ALIVE_S = 1.5 * LEASE_S
_SETTLED_NS = 300_000_000
"""A client that has declared nothing for this time has declared everything."""
_TICK_S = 0.05
_ON_THE_WAY_S = 0.1
_FIRST_ID, _IDS_APART = 41, 1000
_LAST_S = 0.5
_BYTE_S = 0.001
"""Pause between the bytes of a cut frame: the client reads each alone."""


class Ended(Wrong):
    """The client has closed the connection, or has ended."""


class Stage:
    """Listens on a socket, and runs `command` while it is entered."""

    def __init__(self, command: Sequence[str], folder: Path, wait_s: float) -> None:
        self._path = folder / "busd.sock"
        self.client = Client(command, self._path)
        self.wait_s = wait_s
        self._accepted: asyncio.Queue[Peer] = asyncio.Queue()
        self._peers: list[Peer] = []
        self._met = 0
        self._started_ns = 0

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_unix_server(self._on_connected, self._path)
        self._started_ns = monotonic_ns()
        try:
            await self.client.start()
        except BaseException:
            self._server.close()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.close()
        await self.client.stop()
        for peer in self._peers:
            peer.close()

    async def meet(self, terms: Terms = USUAL, *, lease_s: float = LEASE_S, is_cut: bool = False) -> "Peer":
        """The client's next connection, after the exchange of Hellos.

        `is_cut`: all frames to it go byte by byte.
        """
        first_id = _FIRST_ID + _IDS_APART * self._met
        try:
            peer = await self._within(self._accepted.get())
        except TimeoutError:
            again = " again" if self._met else ""
            text = f"it did not connect{again} within {self.wait_s:g} s to the socket in BUSD_SOCKET"
            raise Wrong(text) from None
        self._met += 1
        peer.begin(Conversation(first_id, self._started_ns, terms), lease_s, is_cut=is_cut)
        await peer.until(lambda: peer.hello, "no Hello came")
        return peer

    async def declared(self, terms: Terms = USUAL, **options: Any) -> "Peer":
        """As `meet`, after the client has declared its endpoints."""
        peer = await self.meet(terms, **options)
        await peer.until(lambda: peer.talk.nodes, "no CreateNode came after busd's Hello")
        await peer.until(lambda: peer.talk.endpoints, "no endpoint was created")
        await peer.until(lambda: peer.is_settled, "its declarations never ended")
        return peer

    async def _within(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """The result; Ended if the client ends before, TimeoutError if it takes too long."""
        waiting = asyncio.ensure_future(coroutine)
        try:
            async with asyncio.timeout(self.wait_s):
                while not waiting.done():
                    await asyncio.wait([waiting], timeout=_TICK_S)
                    if not waiting.done() and self.client.status is not None:
                        raise Ended(self.client.end_in_words())
            return waiting.result()
        finally:
            waiting.cancel()

    async def _on_connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        peer = Peer(self, reader, writer)
        self._peers.append(peer)
        self._accepted.put_nowait(peer)


class Peer:
    """One connection of the client, with its conversation `talk`."""

    talk: Conversation

    def __init__(self, stage: Stage, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._stage = stage
        self._reader = reader
        self._writer = writer
        self._session = Session(Role.BROKER)
        self._is_cut = False
        self._declared = 0
        self._declared_ns = 0
        self.hello: m.Hello | None = None
        self.heard_ns = monotonic_ns()
        self.longest_silence_ns = 0

    def begin(self, talk: Conversation, lease_s: float, *, is_cut: bool) -> None:
        self.talk = talk
        self._lease_s = lease_s
        self._is_cut = is_cut
        self.heard_ns = monotonic_ns()

    @property
    def is_settled(self) -> bool:
        """Whether the client has declared everything."""
        return monotonic_ns() - self._declared_ns > _SETTLED_NS

    async def write(self, raw: bytes) -> None:
        """Send bytes; one by one, if this connection is cut.

        Does nothing if the client has closed the connection. Reading reports that.
        """
        size = 1 if self._is_cut else len(raw)
        while raw and not self._writer.is_closing():
            piece, raw = raw[:size], raw[size:]
            self._writer.write(piece)
            if raw:
                await asyncio.sleep(_BYTE_S)

    async def send(self, *messages: m.Message) -> None:
        """Send messages in one piece, if the connection is not cut."""
        await self.write(b"".join(map(m.encode_frame, messages)))

    async def send_fields(self, tag: str, **fields: Any) -> None:
        """Send a message with any tag and fields."""
        body = msgspec.msgpack.encode({"m": tag, **fields})
        await self.write(FRAME_HEAD.pack(FRAME_HEAD_BYTES - LENGTH_BYTES + len(body), CONTROL, 0, 0) + body)

    async def until(
        self,
        done: Callable[[], Any],
        what: str | Callable[[], str],
        wait_s: float | None = None,
        section: str = "",
    ) -> None:
        """Take and answer what the client sends until `done`. Raises Wrong with `what` after `wait_s`.

        `what`: a text, or its maker, which is called at the end. `section`: as in Wrong.
        """
        wait_s = wait_s or self._stage.wait_s
        end = asyncio.get_running_loop().time() + wait_s
        while not done():
            if not await self._turn() and asyncio.get_running_loop().time() > end:
                text = f"{what() if callable(what) else what} within {wait_s:g} s"
                if self._session.reader.is_unfinished:
                    text += "; its last frame is not complete: `length` counts the bytes after itself"
                    section = "Frames"
                raise Wrong(text, section)

    async def listen(self, seconds: float) -> None:
        """Take and answer what the client sends, for a time."""
        end = asyncio.get_running_loop().time() + seconds
        while asyncio.get_running_loop().time() <= end:
            await self._turn()

    async def sign(self, after: str) -> None:
        """Wait for anything that the client sends now. Data that comes at once was sent before."""
        await self.listen(_ON_THE_WAY_S)
        heard = self.talk.heard
        what = f"nothing came from it {after}, not even a Ping,"
        await self.until(lambda: self.talk.heard > heard, what, max(_ALIVE_S, self._lease_s))

    async def end(self, last: m.Message) -> None:
        """Send the last message, and cut the connection when the client does, or a moment later."""
        await self.send(last)
        with suppress(TimeoutError, ConnectionError):
            await asyncio.wait_for(self._reader.read(), _LAST_S)  # to the end
        self.close()

    def close(self) -> None:
        """Cut the connection."""
        self._writer.close()

    async def _turn(self) -> bool:
        """Take the next data; returns whether any came."""
        buffer = self._session.reader.get_buffer()
        try:
            raw = await asyncio.wait_for(self._reader.read(len(buffer)), _TICK_S)
        except TimeoutError:
            self._note_silence()
            return False
        except ConnectionError:
            raw = b""
        if not raw:
            await self._stage.client.wait_for_end()
            raise Ended(f"it closed the connection; {self._stage.client.end_in_words()}")
        self._note_silence()
        self.heard_ns = monotonic_ns()
        buffer[: len(raw)] = raw
        try:
            items = list(self._session.received(len(raw)))
        except RemoteProtocolError as error:
            raise Wrong(str(error)) from None
        for item in items:
            await self._take(item.message if isinstance(item, Carried) else item)
        return True

    async def _take(self, item: Any) -> None:
        if isinstance(item, m.Hello):
            self.hello = item
            await self.send(
                m.Hello(
                    version=PROTOCOL_VERSION,
                    pid=os.getpid(),
                    program="busd",
                    lease_s=self._lease_s,
                    began_ns=1,
                )
            )
            return
        answers = self.talk.hear(item, monotonic_ns())
        if self.talk.declared != self._declared:
            self._declared, self._declared_ns = self.talk.declared, monotonic_ns()
        if answers:
            await self.send(*answers)

    def _note_silence(self) -> None:
        self.longest_silence_ns = max(self.longest_silence_ns, monotonic_ns() - self.heard_ns)
