"""The session of one open page: its frames, their pace, and the topics that it views."""

import asyncio
from contextlib import suppress
from time import monotonic
from typing import Any

from bus.subscription import MessageInfo
from bus_web import page_protocol as protocol
from bus_web.extremes import Extremes
from bus_web.hub import Hub, Watcher
from bus_web.outbox import Outbox
from bus_web.page_log import PageLog
from bus_web.page_playback import PagePlayback
from bus_web.playback import Playback
from bus_web.sender import Sender, Socket
from bus_web.shared_subscriptions import Heard
from bus_web.tree import tree_of

__all__ = ["PageSession"]

_VALUE_S = 0.05
"""At most 20 values of a topic in a second."""
_MOST_WAITING = 2 << 20
"""Bytes. A page shows what is now: it may have less in store than a client that records."""
_MOST_FRAMES = 8
"""Most frames cached for one message, for pages that show it differently."""


class _Look:
    """A topic that the page looks at."""

    def __init__(self, opened: frozenset[str]) -> None:
        self.opened = opened
        self.extremes = Extremes()
        self.shown_s = 0.0
        self.waiting: Heard | None = None
        self.shown: Heard | None = None
        self.timer: asyncio.TimerHandle | None = None


class PageSession(Watcher):
    """Speaks `busd.page.v1` on `socket` until that ends (`run`). With a `playback` the page controls that."""

    def __init__(self, hub: Hub, socket: Socket, bus: str, playback: Playback | None = None) -> None:
        self._hub = hub
        self._socket = socket
        self._bus = bus
        self._loop = asyncio.get_running_loop()
        self._sender = Sender(socket, Outbox(_MOST_WAITING, hub.waiting))
        self._sent = protocol.Sent()
        self._is_graph_due = self._is_first = True
        self._looks: dict[str, _Look] = {}
        self._log = PageLog(hub.subscriptions, self._sender)
        self._playback = playback
        self._player: PagePlayback | None = None

    async def run(self) -> None:
        """Raises Mistake for an invalid request, and the socket's exception when the socket ends."""
        self._notify("hello", bus=self._bus)
        sending = self._loop.create_task(self._sender.run())
        if self._playback is not None:
            self._player = PagePlayback(self._playback, self._sender, self._forget_values)
        try:
            async with self._hub.watching(self):
                if self._hub.is_lost:
                    self.lost("busd does not answer")
                elif self._hub.has_looked:
                    self.looked(is_new=True)
                while True:
                    self._on_frame(await self._socket.recv())
        finally:
            sending.cancel()
            if self._player is not None:
                await self._player.close()
            self._watch(protocol.Look({}))
            self._log.show(on=False)
            self._sender.close()
            await asyncio.gather(sending, return_exceptions=True)

    # --- of the hub

    def looked(self, *, is_new: bool) -> None:
        self._is_graph_due |= is_new
        if self._sender.notices:  # it has not read the last look yet: the next it gets is newer
            return
        model = self._hub.model
        if self._is_graph_due:
            self._is_graph_due = False
            self._sender.notify(protocol.graph(model))
            if self._is_first:
                self._is_first = False
                self._sender.notify(protocol.history(model.topics(hidden=True)))
        self._sender.notify(self._sent.rates(model))
        if self._looks:
            self._send_details()
        if dropped := self._sender.take_dropped():
            self._notify("status", dropped=dropped)

    def lost(self, text: str) -> None:
        self._notify("bus", is_up=False, text=text)  # also to a slow page: it gets this once for each loss

    # --- of the subscriptions

    def on_message(self, topic: str, heard: Heard) -> None:
        if (look := self._looks.get(topic)) is not None:
            size = len(heard.payload)
            if look.extremes.has_room(size):
                with suppress(Exception):  # the bytes come from a stranger; `_show` tells the page
                    look.extremes.add(heard.message, size, heard.info.source_timestamp)
            self._await_turn(topic, look, heard)

    def _await_turn(self, topic: str, look: _Look, heard: Heard) -> None:
        look.waiting = heard
        if look.timer is None:
            wait_s = look.shown_s + _VALUE_S - self._loop.time()
            if wait_s <= 0:
                self._show(topic, look)
            else:
                look.timer = self._loop.call_later(wait_s, self._show, topic, look)

    def on_fault(self, topic: str, text: str) -> None:
        if topic in self._looks:
            self._sender.put(topic, protocol.message("fault", topic=topic, text=text))

    # --- of the page

    def _on_frame(self, frame: str | bytes) -> None:
        said = protocol.read(frame)
        if isinstance(said, protocol.Look):
            self._watch(said)
        elif isinstance(said, protocol.Log):
            self._log.show(on=said.on)
        elif self._player is not None:
            self._player.ask(said)
        else:
            raise protocol.Mistake("no bag is played here: start bus web with --bag")

    def _watch(self, wanted: protocol.Look) -> None:
        topics = wanted.opened()
        for topic in [*self._looks]:
            if topic not in topics:
                look = self._looks.pop(topic)
                if look.timer is not None:
                    look.timer.cancel()
                self._sender.forget(topic)
                self._hub.subscriptions.remove(topic, self)
        for topic, opened in topics.items():
            known = self._looks.get(topic)
            if known is None:
                self._looks[topic] = _Look(opened)
                self._hub.subscriptions.add(topic, self)
            elif known.opened != opened:
                known.opened = opened
                if known.shown is not None and known.waiting is None:
                    self._await_turn(topic, known, known.shown)
            extremes = Extremes(wanted.plots.get(topic, ()))
            if self._looks[topic].extremes.paths != extremes.paths:
                self._looks[topic].extremes = extremes
        if topics and self._hub.has_looked and not self._sender.notices:
            self._send_details()

    def _forget_values(self) -> None:
        """Drop values that the page has not got yet: the recording is at another time now."""
        for topic, look in self._looks.items():
            if look.timer is not None:
                look.timer.cancel()
            look.timer = look.waiting = look.shown = None
            look.extremes.clear()
            self._sender.forget(topic)

    def _show(self, topic: str, look: _Look) -> None:
        look.timer = None
        heard, look.waiting = look.waiting, None
        if heard is None or self._looks.get(topic) is not look:
            return
        look.shown_s = self._loop.time()
        look.shown = heard
        between = look.extremes.take()
        shown = look.opened, between
        frame = heard.frames.get(shown)  # for all pages that show the same of it
        if frame is None:
            try:
                tree = tree_of(heard.message, look.opened)
            except Exception as error:  # the bytes come from a stranger
                self.on_fault(topic, f"a message does not decode: {error}")
                return
            info = heard.info
            if len(heard.frames) >= _MOST_FRAMES:
                heard.frames.clear()
            frame = heard.frames[shown] = protocol.message(
                "value",
                topic=topic,
                type=heard.type_name,
                number=heard.number,
                bytes=len(heard.payload),
                at_ms=info.source_timestamp / 1e6,
                age_ms=round(self._age_ns(info) / 1e6, 3),
                tree=tree,
                **(protocol.between(between) if between else {}),
            )
        self._sender.put(topic, frame)

    def _age_ns(self, info: MessageInfo) -> int:
        """The age of a message on arrival; of a recorded one, in the time of its recording."""
        sent_ns, came_ns = info.source_timestamp, info.received_timestamp
        if self._playback is not None and sent_ns <= self._playback.recording.end_ns:
            came_ns = self._playback.state.at_ns
        return came_ns - sent_ns

    # --- to the page

    def _send_details(self) -> None:
        self._sender.notify(protocol.detail(self._hub.model, self._looks, monotonic()))

    def _notify(self, op: str, **fields: Any) -> None:
        self._sender.notify(protocol.message(op, **fields))
