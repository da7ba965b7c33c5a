"""Tells a stream that the other side of its socket has gone, where its event loop may not.

A process that is killed may leave bytes unread. Then the other end of its socket has an error, which libuv
reports only once: a stream that read a part of what was there would never hear of the rest, nor of the end.
Asking the socket after each read would cost a system call for each message. So one epoll for all streams of
an event loop waits for the end and nothing else. asyncio's own loops report an error as long as it is there,
and need none of this.
"""

import asyncio
import select
from collections.abc import Callable
from typing import ClassVar
from weakref import WeakValueDictionary


class HangUps:
    """Shared by the streams of an event loop, got with `of`; closed with the last of them."""

    _all: ClassVar["WeakValueDictionary[int, HangUps]"] = WeakValueDictionary()
    """By the id of the loop, which each holds: a look-up is safe while other threads add theirs."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self._epoll = select.epoll()
        self._actions: dict[int, Callable[[], None]] = {}
        loop.add_reader(self._epoll.fileno(), self._on_readable)
        HangUps._all[id(loop)] = self

    @classmethod
    def of(cls, loop: asyncio.AbstractEventLoop) -> "HangUps | None":
        """That of `loop`; None where none is needed, or there is no epoll."""
        if isinstance(loop, asyncio.SelectorEventLoop) or not hasattr(select, "epoll"):
            return None
        one = cls._all.get(id(loop))
        return cls(loop) if one is None or one._epoll.closed else one

    def watch(self, number: int, action: Callable[[], None]) -> None:
        """Call `action` once, when the other side of descriptor `number` has gone."""
        self._actions[number] = action
        self._epoll.register(number, select.EPOLLONESHOT)  # epoll reports the end whatever is asked for

    def forget(self, number: int) -> None:
        """Forget the descriptor; to be called before it is closed."""
        if self._actions.pop(number, None) is not None:
            self._epoll.unregister(number)
            if not self._actions:
                self.loop.remove_reader(self._epoll.fileno())
                self._epoll.close()

    def abandon(self) -> None:
        """In the child of a fork: what is registered is the parent's, and so is the event loop."""
        self._epoll.close()

    def _on_readable(self) -> None:
        for number, _ in self._epoll.poll(0):
            action = self._actions.get(number)
            if action is not None:
                action()
