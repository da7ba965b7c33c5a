"""Requests for busd itself that come over the wire: a restart, or to read the configuration again.

The core has checked that the peer may ask for it. Must not know how either is done.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Protocol

from bus.base.ids import PeerId
from bus.errors import ConfigurationError
from bus.wire.messages import Done, Message, Refused
from busd.core.effects import Restart
from busd.process.repetitions import Repetitions

__all__ = ["RequestHost", "Requests"]


class RequestHost(Protocol):
    """Services of the server to requests."""

    @property
    def is_ending(self) -> bool: ...

    def answer(self, peer: PeerId, answer: Message) -> None: ...

    def restart(self, reason: str) -> None: ...


class Requests:
    """`find_fault` gives the reason against a restart, or "" (None: no restart is possible).

    `reload` returns the changes, or raises ConfigurationError.
    """

    def __init__(
        self,
        host: RequestHost,
        find_fault: Callable[[], Awaitable[str]] | None,
        reload: Callable[[], str] | None,
    ) -> None:
        self._host = host
        self._find_fault = find_fault
        self._reload = reload
        self._loop = asyncio.get_running_loop()
        self._restart: asyncio.Task[None] | None = None
        self._refusals = Repetitions()

    def restart(self, asked: Restart) -> None:
        """Restart if that is possible, and answer whether it is. Checking the reasons takes a while."""
        self._restart = self._loop.create_task(self._try_restart(asked, self._restart))

    def reload(self, peer: PeerId, request: int) -> None:
        """Read the configuration again and answer, after the effects that are being carried out."""
        self._loop.call_soon(self._try_reload, peer, request)

    async def _try_restart(self, asked: Restart, before: asyncio.Task[None] | None) -> None:
        if self._find_fault is None:
            fault = "this busd can't restart"
        elif self._host.is_ending or (before is not None and not before.done()):
            fault = "busd is stopping"
        else:
            fault = await self._find_fault()
        if fault:
            self._refusals.log(logging.ERROR, f"no restart: {fault}")
            self._host.answer(asked.peer, Refused(request=asked.request, text=fault))
        else:
            self._host.answer(asked.peer, Done(request=asked.request))
            self._host.restart(asked.reason)

    def _try_reload(self, peer: PeerId, request: int) -> None:
        try:
            text = self._reload() if self._reload is not None else ""
            self._host.answer(peer, Done(request=request, text=text))
        except ConfigurationError as error:
            self._host.answer(peer, Refused(request=request, text=str(error)))
