"""Lines of /rosout for one page: gathered, and sent a few times a second."""

import asyncio
from collections import deque
from typing import Any

from bus_web import page_protocol as protocol
from bus_web.sender import Sender
from bus_web.shared_subscriptions import Heard, SharedSubscriptions

__all__ = ["PageLog"]

_ROSOUT = "/rosout"
_PERIOD_S = 0.2
_MOST_LINES = 200
_MOST_TEXT = 2000
_MOST_NAME = 200


class PageLog:
    """Listens while the page shows the log (`show`)."""

    def __init__(self, subscriptions: SharedSubscriptions, sender: Sender) -> None:
        self._subscriptions = subscriptions
        self._sender = sender
        self._is_shown = False
        self._lines: deque[list[Any]] = deque(maxlen=_MOST_LINES)
        self._left_out = 0
        self._timer: asyncio.TimerHandle | None = None

    def show(self, *, on: bool) -> None:
        if on == self._is_shown:
            return
        self._is_shown = on
        if on:
            self._subscriptions.add(_ROSOUT, self)
            return
        self._subscriptions.remove(_ROSOUT, self)
        self._lines.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def on_message(self, topic: str, heard: Heard) -> None:
        try:
            line = heard.message
            at_s = line.stamp.sec + line.stamp.nanosec / 1e9
            text = [round(at_s * 1000), line.level, line.name[:_MOST_NAME], line.msg[:_MOST_TEXT]]
        except Exception:  # /rosout of some other type
            return
        if len(self._lines) == _MOST_LINES:
            self._left_out += 1
        self._lines.append(text)
        if self._timer is None:
            self._send_later()

    def on_fault(self, topic: str, text: str) -> None:
        """The log stays empty."""

    def _send_later(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(_PERIOD_S, self._send)

    def _send(self) -> None:
        if self._sender.notices:  # it does not read
            self._send_later()
            return
        self._timer = None
        self._sender.notify(protocol.message("log", lines=[*self._lines], left_out=self._left_out))
        self._lines.clear()
        self._left_out = 0
