"""The part of a page's session about the playback of a recording: its state, and requests to it."""

import asyncio
from collections.abc import Callable
from contextlib import ExitStack
from math import ceil, floor
from typing import Any

from bus_web import page_protocol as protocol
from bus_web.playback import Losses, Playback, Recording, Request, State
from bus_web.sender import Sender

__all__ = ["PagePlayback", "recording_fields"]

_MOST_WAITING = 16
"""Requests of a page that wait for the player; more are refused."""
_MOST_BARS, _MOST_TOPICS, _MOST_BURSTS = 120, 20, 20
_STATE = "playback"
"""Stands for a topic in the outbox; no topic is called so."""
_NS_PER_S = 1_000_000_000


class PagePlayback:
    """Shows a playback on one page. `close` it in the end.

    `jumped` is called after a seek, before the page learns about it.
    """

    def __init__(self, playback: Playback, sender: Sender, jumped: Callable[[], None]) -> None:
        self._playback = playback
        self._sender = sender
        self._jumped = jumped
        self._waiting: asyncio.Queue[Request] = asyncio.Queue(_MOST_WAITING)
        self._told: State | None = None
        self._stack = ExitStack()
        sender.notify(protocol.message("recording", **recording_fields(playback.recording)))
        self._stack.enter_context(playback.watching(self._show))
        self._show()
        self._asking = asyncio.get_running_loop().create_task(self._ask())

    def ask(self, said: protocol.Play) -> None:
        """Pass the request on, after all earlier ones of this page."""
        seek_ns = None
        if said.at_s is not None:
            seek_ns = self._playback.recording.start_ns + round(said.at_s * _NS_PER_S)
        request = Request(seek_ns=seek_ns, rate=said.rate, is_paused=said.paused, step=said.step)
        try:
            self._waiting.put_nowait(request)
        except asyncio.QueueFull:
            self._refuse(f"{_MOST_WAITING} requests are waiting for the player")

    async def close(self) -> None:
        """End requests that still wait."""
        self._stack.close()
        self._asking.cancel()
        await asyncio.gather(self._asking, return_exceptions=True)

    async def _ask(self) -> None:
        while True:
            refusal = await self._playback.ask(await self._waiting.get())
            if refusal:
                self._refuse(refusal)
            self._show()

    def _refuse(self, text: str) -> None:
        if not self._sender.is_behind:
            self._sender.notify(protocol.message("refused", text=text))

    def _show(self) -> None:
        """Send the state if it has changed. Only the newest state is of interest to a slow page."""
        state = self._playback.state
        if state == self._told:
            return
        if self._told is not None and self._told.seeks != state.seeks:
            self._jumped()
        self._told = state
        at_s = (state.at_ns - self._playback.recording.start_ns) / _NS_PER_S
        frame = protocol.message(
            "playback",
            status=state.status.value,
            at_s=round(at_s, 3),
            rate=state.rate,
            messages=state.messages,
            seeks=state.seeks,
        )
        self._sender.forget(_STATE)
        self._sender.put(_STATE, frame)


def recording_fields(recording: Recording) -> dict[str, Any]:
    """The frame about a recording: its name and length, and when messages were lost.

    Times are seconds from its start on. At most 20 topics, the ones with most losses.
    """
    start_s, end_s = recording.start_ns / _NS_PER_S, recording.end_ns / _NS_PER_S
    fields: dict[str, Any] = {
        "name": recording.name,
        "start_ms": recording.start_ns / 1e6,
        "span_s": round(end_s - start_s, 3),
        "losses": None,
    }
    if recording.losses is None:
        return fields
    most_first = sorted(recording.losses.items(), key=lambda one: (-one[1].lost, one[0]))
    fields["losses"] = [_row(name, one, start_s, end_s) for name, one in most_first[:_MOST_TOPICS]]
    fields["more"] = max(0, len(most_first) - _MOST_TOPICS)
    return fields


def _row(name: str, one: Losses, start_s: float, end_s: float) -> dict[str, Any]:
    """Losses of a topic. Bars are whole seconds wide, because the recorder counts in seconds."""
    begin_s = floor(start_s)
    width_s = max(1, ceil((end_s - begin_s) / _MOST_BARS))
    number = max(1, ceil((end_s - begin_s) / width_s))
    bars = one.timeline.bars(begin_s, begin_s + number * width_s, number)
    return {
        "topic": name,
        "lost": one.lost,
        "expected": one.expected,
        "begin_s": round(begin_s - start_s, 6),
        "width_s": width_s,
        "bars": [float(f"{value:.3g}") for value in bars],
        "bursts": [
            [round(burst.at_s - start_s, 6), burst.span_s, burst.lost]
            for burst in one.timeline.bursts(_MOST_BURSTS)
        ],
        "earlier": one.timeline.earlier,
    }
