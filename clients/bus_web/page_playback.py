"""The part of a page's session about the playback of a recording: its state, and requests to it."""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from bus.base.counted import counted
from bus_web import page_protocol as protocol
from bus_web.playback import Losses, Playback, Recording, Request, State
from bus_web.sender import Sender

__all__ = ["PagePlayback", "recording_fields"]

_MOST_WAITING = 16
"""Requests of a page that wait for the player; more are refused."""
_BARS, _MOST_TOPICS, _MOST_BURSTS = 120, 3, 12
_STATE = "playback"
"""Stands for a topic in the outbox; no topic is called so."""
_NS_PER_S = 1_000_000_000
_DAY_S = 86_400


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
            paused=state.is_paused,
            at_s=round(at_s, 3),
            rate=state.rate,
            messages=state.messages,
            seeks=state.seeks,
        )
        self._sender.forget(_STATE)
        self._sender.put(_STATE, frame)


def recording_fields(recording: Recording) -> dict[str, Any]:
    """The frame about a recording: its length, and when messages were lost.

    Times are seconds from its start on. `bars`: messages lost in equal parts of the recording, of all topics
    together. `bursts`: the largest ones, by time, each with its begin and a text.
    """
    start_s, end_s = recording.start_ns / _NS_PER_S, recording.end_ns / _NS_PER_S
    losses = recording.losses or {}
    bars = [0.0] * _BARS
    for one in losses.values():
        parts = one.timeline.bars(start_s, max(end_s, start_s + 1), _BARS)
        bars = [whole + part for whole, part in zip(bars, parts, strict=True)]
    return {
        "start_ms": recording.start_ns / 1e6 if start_s > _DAY_S else None,  # else its time is simulated
        "span_s": round(end_s - start_s, 3),
        "note": f"{recording.name}: {_note(recording)}",
        "bars": [float(f"{value:.3g}") for value in bars] if losses else [],
        "bursts": _bursts(losses, start_s, end_s),
    }


def _note(recording: Recording) -> str:
    if recording.fault:
        return recording.fault
    if recording.losses is None:
        return "it has no record of losses; only bus bag record writes one"
    most_first = sorted(recording.losses.items(), key=lambda one: (-one[1].lost, one[0]))
    if not most_first:
        return "the recorder lost no messages"
    texts = [f"{name} lost {one.lost:,} of {one.expected:,}" for name, one in most_first[:_MOST_TOPICS]]
    if (more := len(most_first) - len(texts)) > 0:
        texts.append(f"{counted(more, 'more topic')}")
    return f"while recording, {'; '.join(texts)}"


def _bursts(losses: Mapping[str, Losses], start_s: float, end_s: float) -> list[tuple[float, str]]:
    found = [(name, burst) for name, one in losses.items() for burst in one.timeline.bursts(_MOST_BURSTS)]
    largest = sorted(found, key=lambda one: -sum(one[1].lost.values()))[:_MOST_BURSTS]
    rows = []
    for name, burst in sorted(largest, key=lambda one: (one[1].at_s, one[0])):
        lost = ", ".join(
            f"{count:,} {reason.replace('_', ' ')}" for reason, count in burst.lost.items() if count
        )
        span = f" in {burst.span_s} s" if burst.span_s > 1 else ""
        at_s = min(max(burst.at_s, start_s), end_s) - start_s
        rows.append((round(at_s, 6), f"{name} lost {lost}{span}"))
    return rows
