"""A proxy between an actor and busd, which cuts a connection after any byte; descriptors are passed on.

It is a thread of the actor: busd sees the right process. While the other side has not taken the data read so
far, it reads no more: back-pressure passes through.
"""

import contextlib
import random
import select
import selectors
import socket
import threading
from collections import deque
from itertools import chain
from pathlib import Path
from typing import Self

_READ_BYTES = 1 << 16
_MOST_DESCRIPTORS = 64
_ENDLESS = 1 << 60


class _Way:
    """One direction of a connection."""

    def __init__(self, source: socket.socket, target: socket.socket) -> None:
        self.source = source
        self.target = target
        self.waiting: deque[tuple[bytes, list[int]]] = deque()
        self.budget = _ENDLESS
        """Bytes that it may still pass on; then the connection is cut."""

    def read(self) -> bool:
        """Take received data, if nothing waits; returns whether the connection continues."""
        try:
            data, descriptors, _, _ = socket.recv_fds(self.source, _READ_BYTES, _MOST_DESCRIPTORS)
        except BlockingIOError:
            return True
        except OSError:
            return False
        if not data:
            return False
        self.waiting.append((data, descriptors))
        return self.write()

    def pass_on(self) -> None:
        """Pass on all received data, as far as the other side takes it."""
        while not self.waiting and select.select([self.source], [], [], 0)[0] and self.read():
            pass

    def write(self) -> bool:
        """Write waiting data; returns the same as `read`."""
        while self.waiting and self.budget:
            data, descriptors = self.waiting[0]
            try:
                sent = socket.send_fds(self.target, [data[: self.budget]], descriptors)
            except BlockingIOError:
                return True
            except OSError:
                return False
            _close(descriptors)
            self.budget -= sent
            self.waiting.popleft()
            if sent < len(data):
                self.waiting.appendleft((data[sent:], []))
        return self.budget > 0

    def close(self) -> None:
        for _, descriptors in self.waiting:
            _close(descriptors)
        self.source.close()


class Proxy:
    """Listens at `path`, passes on to `target`."""

    def __init__(self, path: Path, target: Path) -> None:
        self.cuts = 0
        self._target = target
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(str(path))
        self._listening.listen(64)
        self._listening.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listening, selectors.EVENT_READ)
        self._ways: list[tuple[_Way, _Way]] = []
        self._orders: deque[tuple[random.Random, int] | None] = deque()
        self.hang_ups = 0
        """Calls of `hang_up` that are done: each connection of that time is cut."""
        self._is_hanging_up = False
        self._ours, self._theirs = socket.socketpair()
        self._selector.register(self._theirs, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run, name="proxy")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()
        self._thread.join()

    def cut(self, after_bytes: int, seed: int) -> None:
        """Cut some connection after this many more bytes in one of its directions."""
        self._orders.append((random.Random(seed), after_bytes))
        self._ours.send(b"x")

    def hang_up(self) -> None:
        """Cut all connections after earlier data has passed, as far as it is taken."""
        self._is_hanging_up = True
        self._ours.send(b"x")

    def spare(self) -> None:
        """Stop cutting."""
        self._orders.append(None)
        self._ours.send(b"x")

    def _run(self) -> None:
        try:
            while self._turn():
                pass
        finally:
            for ways in tuple(self._ways):
                self._end(ways)
            self._selector.close()
            self._listening.close()
            self._theirs.close()

    def _turn(self) -> bool:
        for key, events in self._selector.select():
            if key.fileobj is self._listening:
                self._accept()
            elif key.fileobj is self._theirs:
                if not self._theirs.recv(64):
                    return False
                self._obey()
            elif key.data in self._ways:
                ways: tuple[_Way, _Way] = key.data
                inward, outward = ways if ways[0].source is key.fileobj else ways[::-1]
                goes_on = not events & selectors.EVENT_WRITE or outward.write()
                if goes_on and events & selectors.EVENT_READ and not inward.waiting:
                    goes_on = inward.read()
                if goes_on:
                    self._watch(ways)
                else:
                    self._end(ways)
        return True

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._listening.accept()
            broker = socket.socket(socket.AF_UNIX)
            try:
                broker.connect(str(self._target))
            except OSError:
                broker.close()
                client.close()
                return
            for one in (client, broker):
                one.setblocking(False)
            ways = (_Way(client, broker), _Way(broker, client))
            self._ways.append(ways)
            for way in ways:
                self._selector.register(way.source, selectors.EVENT_READ, ways)

    def _obey(self) -> None:
        if self._is_hanging_up:
            self._is_hanging_up = False
            for ways in tuple(self._ways):
                for way in ways:
                    way.pass_on()
                self._end(ways)
            self.hang_ups += 1
        while self._orders:
            order = self._orders.popleft()
            if order is None:
                for way in chain.from_iterable(self._ways):
                    way.budget = _ENDLESS
            elif self._ways:
                chance, after_bytes = order
                chance.choice(chance.choice(self._ways)).budget = after_bytes

    def _watch(self, ways: tuple[_Way, _Way]) -> None:
        for inward, outward in (ways, ways[::-1]):
            reads = 0 if inward.waiting else selectors.EVENT_READ
            writes = selectors.EVENT_WRITE if outward.waiting else 0
            if self._selector.get_map().get(inward.source) is not None:
                self._selector.unregister(inward.source)
            if reads | writes:
                self._selector.register(inward.source, reads | writes, ways)

    def _end(self, ways: tuple[_Way, _Way]) -> None:
        self._ways.remove(ways)
        self.cuts += any(not way.budget for way in ways)
        for way in ways:
            with contextlib.suppress(KeyError):
                self._selector.unregister(way.source)
            way.close()


def _close(descriptors: list[int]) -> None:
    for descriptor in descriptors:
        socket.close(descriptor)
