"""zenoh's own log, the only source of refused connections and their reasons.

zenoh writes it to the stdout of the process, in its own threads. This module replaces stdout by a pipe. It
filters lines about connections, and forwards all other output to the original stdout. zenoh does not log
addresses.
"""

import asyncio
import os
import re
import sys
from collections.abc import Callable

import zenoh

__all__ = ["OwnLog", "reason_of"]

_WARNINGS = "zenoh_link_tls=warn,zenoh_link_quic=warn,zenoh_link_commons=warn,zenoh_link_tcp=warn"
_STDOUT = 1
_PAUSE_S = 10.0
_AT_ONCE = 64 << 10
_LONGEST_REASON = 200

_COLOURS = re.compile(rb"\x1b\[[0-9;]*m")
_REFUSED = re.compile(r"\S+Z +(?:WARN|ERROR) .*?\bzenoh_link_\w+(?:::\w+)*: (.*)")
_SAID_BY_THE_OTHER_SIDE = re.compile(r'reason: b"(.*?)"')
_PLACE = re.compile(r" at \S+\.rs:\d+$")


class OwnLog:
    """Calls `warn` for refused connections: at once, then at most once in ten seconds.

    Only use it in a process that belongs to the bridge, because all output of the process goes through the
    pipe.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self.refused = 0
        """Number of refused connections."""
        self.reason = ""
        """The reason of the last refusal."""
        self._warn = warn
        self._loop = asyncio.get_running_loop()
        self._pipe = self._stdout = -1
        self._begun = b""  # the beginning of an incomplete line
        self._said = 0
        self._pause: asyncio.TimerHandle | None = None

    def open(self) -> None:
        """Start. Does nothing if the process has no stdout."""
        if sys.stdout is None:
            return
        self._stdout = os.dup(_STDOUT)
        self._pipe, writer = os.pipe()
        os.set_blocking(self._pipe, False)
        os.dup2(writer, _STDOUT)
        os.close(writer)
        self._loop.add_reader(self._pipe, self._read)
        zenoh.init_log_from_env_or(_WARNINGS)

    def close(self) -> None:
        """Restore the original stdout of the process."""
        if self._pipe < 0:
            return
        if self._pause is not None:
            self._pause.cancel()
        os.dup2(self._stdout, _STDOUT)
        self._loop.remove_reader(self._pipe)
        self._read()
        self._hand_on(self._begun)
        os.close(self._pipe)
        os.close(self._stdout)
        self._pipe = -1

    def _read(self) -> None:
        try:
            *lines, self._begun = (self._begun + os.read(self._pipe, _AT_ONCE)).split(b"\n")
        except BlockingIOError:
            return
        other = [line + b"\n" for line in lines if not self._is_taken(line)]
        if len(self._begun) > _AT_ONCE:
            other.append(self._begun)
            self._begun = b""
        self._hand_on(b"".join(other))

    def _is_taken(self, line: bytes) -> bool:
        reason = reason_of(line)
        if reason:
            self.refused += 1
            self.reason = reason
            if self._pause is None:
                self._say()
        return bool(reason)

    def _say(self) -> None:
        self._pause = None
        if self._said < self.refused:
            more = self.refused - self._said
            what = "a connection was" if more == 1 else f"{more} connections were"
            total = "" if more == self.refused else f", {self.refused} so far"
            self._said = self.refused
            self._warn(f"{what} refused{total}: {self.reason} (zenoh does not say from where)")
            self._pause = self._loop.call_later(_PAUSE_S, self._say)

    def _hand_on(self, text: bytes) -> None:
        try:
            while text:
                text = text[os.write(self._stdout, text) :]
        except OSError:  # the reader has gone: ignore it, as print does
            pass


def reason_of(line: bytes) -> str:
    """The reason of a refused connection, if a line of zenoh's log has one; otherwise ""."""
    found = _REFUSED.match(_COLOURS.sub(b"", line).decode(errors="replace"))
    if found is None:
        return ""
    said = _SAID_BY_THE_OTHER_SIDE.search(found[1])
    text = said[1] if said else _PLACE.sub("", found[1].partition(". Hint: ")[0])
    return text[:_LONGEST_REASON].strip() or "no reason given"
