"""Informs a stream that the other side of its socket has gone, if its event loop may not do that.

A killed process may leave bytes unread. Then the other end of its socket has an error, which libuv reports
only once. A stream that has read a part of the waiting bytes would never notice the rest, or the end. A check
of the socket after each read would cost a system call for each message. So one epoll for all streams of an
event loop waits only for the end. asyncio's own loops report an error as long as it exists, and don't need
this.
"""

import asyncio
import select
from collections.abc import Callable
from typing import ClassVar
from weakref import WeakValueDictionary


class HangUps:
    """One object for all streams of an event loop, returned by `of`; closed with the last of them."""

    _all: ClassVar["WeakValueDictionary[int, HangUps]"] = WeakValueDictionary()
    """The objects by the id of the loop, to which each refers.

    A look-up is safe while other threads add objects.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self._epoll = select.epoll()
        self._actions: dict[int, Callable[[], None]] = {}
        loop.add_reader(self._epoll.fileno(), self._on_readable)
        HangUps._all[id(loop)] = self

    @classmethod
    def of(cls, loop: asyncio.AbstractEventLoop) -> "HangUps | None":
        """The object of `loop`; None if it is not needed, or if there is no epoll."""
        if isinstance(loop, asyncio.SelectorEventLoop) or not hasattr(select, "epoll"):
            return None
        one = cls._all.get(id(loop))
        return cls(loop) if one is None or one._epoll.closed else one

    def watch(self, number: int, action: Callable[[], None]) -> None:
        """Call `action` once, when the other side of descriptor `number` has gone."""
        self._actions[number] = action
        self._epoll.register(number, select.EPOLLONESHOT)  # epoll always reports the end

    def forget(self, number: int) -> None:
        """Forget the descriptor; must be called before it is closed."""
        if self._actions.pop(number, None) is not None:
            self._epoll.unregister(number)
            if not self._actions:
                self.loop.remove_reader(self._epoll.fileno())
                self._epoll.close()

    def abandon(self) -> None:
        """End in the child of a fork, where registered descriptors and the event loop are the parent's."""
        self._epoll.close()

    def _on_readable(self) -> None:
        for number, _ in self._epoll.poll(0):
            action = self._actions.get(number)
            if action is not None:
                action()
