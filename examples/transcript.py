"""Forwards the output of several programs in order, and remembers the messages in it."""

import asyncio
import os
import re
import signal
import sys
from collections import defaultdict
from collections.abc import Callable

_SAID = re.compile(r'\[(\w+)\]: (?:Publishing|I heard): "(.*)"')


class Transcript:
    """The output of the programs. All use one pipe, so their lines keep their order."""

    def __init__(self) -> None:
        self.texts: dict[str, list[str]] = defaultdict(list)
        """The messages that each node published or received."""
        self._source, self.sink = os.pipe()
        os.set_blocking(self._source, False)
        asyncio.get_running_loop().add_reader(self._source, self.read)
        self._news = asyncio.Event()
        self._rest = b""

    def read(self) -> None:
        """Forward and remember all output so far."""
        try:
            while True:
                *lines, self._rest = (self._rest + os.read(self._source, 65536)).split(b"\n")
                for line in lines:
                    text = line.decode(errors="replace")
                    print(text, flush=True)
                    if said := _SAID.search(text):
                        self.texts[said[1]].append(said[2])
        except BlockingIOError:
            self._news.set()
        except BrokenPipeError:  # the reader of the output is gone: end like on Ctrl-C
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            signal.raise_signal(signal.SIGTERM)

    async def wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait until the output makes `condition` true."""
        while not condition():
            self._news.clear()
            await self._news.wait()
