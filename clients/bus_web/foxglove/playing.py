"""The playback of a recording for one viewer: its requests, and the states of the player."""

from contextlib import ExitStack
from typing import Any

from bus_web.foxglove import protocol
from bus_web.foxglove.client import Client
from bus_web.foxglove.protocol import Level, PlaybackStatus
from bus_web.playback import Playback, Request, State, Status

__all__ = ["Playing"]

_STATUS = {
    Status.PLAYING: PlaybackStatus.PLAYING,
    Status.PAUSED: PlaybackStatus.PAUSED,
    Status.READING: PlaybackStatus.BUFFERING,
    Status.AT_END: PlaybackStatus.ENDED,
}
_NS_PER_S = 1_000_000_000
_MOST_S = 2**32 - 1


class Playing:
    """Sends states after `begin`, until `close`."""

    def __init__(self, playback: Playback, client: Client) -> None:
        self._playback = playback
        self._client = client
        self._told: State | None = None
        self._stack = ExitStack()

    @property
    def now_ns(self) -> int:
        """The time of the recording, as the time of messages."""
        return self._playback.state.at_ns

    def server_info(self) -> dict[str, Any]:
        """The fields of the server's message about itself: the first and the last time of the recording."""
        recording = self._playback.recording
        return {"dataStartTime": _time(recording.start_ns), "dataEndTime": _time(recording.end_ns)}

    def begin(self) -> None:
        """Send the state, and from now on its changes. The positions between them are `time` messages."""
        self._stack.enter_context(self._playback.watching(self.follow))
        self.follow()

    async def ask(self, said: protocol.PlaybackRequest) -> None:
        """Pass a request on. The answer is the state after it; if it seeks, the state at the jump, because
        viewers forget the messages that came before. The rate and the pause are the new ones then, too."""
        # The speed has 32 bits: the nearest one to 0.1 means 0.1.
        rate = float(f"{said.speed:.7g}")
        request = Request(seek_ns=said.seek_ns, rate=rate, is_paused=said.is_paused)
        is_answered = False

        def answer() -> None:
            nonlocal is_answered
            if not is_answered:
                is_answered = True
                self._send(said.id)

        if refusal := await self._playback.ask(request, answer):
            self._client.say(Level.WARNING, refusal, "playback")
        answer()
        self.follow()

    def answer(self, said: protocol.PlaybackRequest) -> None:
        """Answer a request by the present state, without passing it on."""
        self._send(said.id)

    def close(self) -> None:
        """The client has gone."""
        self._stack.close()

    def follow(self) -> None:
        """Send the state if it is new. A client that is behind gets it later, when this is called again."""
        state, told = self._playback.state, self._told
        is_new = told is None or (state.status, state.rate, state.seeks) != (
            told.status,
            told.rate,
            told.seeks,
        )
        if is_new and not self._client.is_behind:
            self._send()

    def _send(self, id: str = "") -> None:
        state, told = self._playback.state, self._told
        self._told = state
        did_seek = told is not None and state.seeks != told.seeks
        frame = protocol.playback_state(
            _STATUS[state.status], max(0, state.at_ns), state.rate, did_seek=did_seek, id=id
        )
        self._client.notify(frame)


def _time(ns: int) -> dict[str, int]:
    seconds, rest = divmod(max(0, ns), _NS_PER_S)
    return {"sec": min(seconds, _MOST_S), "nsec": rest}
