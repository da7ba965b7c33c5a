"""The child's half of the harness: reads words from stdin, writes events to stdout, ends at the end of
stdin."""

import asyncio
import gc
import json
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import msgspec
import uvloop

LIFE_S = 300
"""The longest life of a worker in any case, unless it sets another."""


class Parent:
    """The process that started this one."""

    def __init__(self) -> None:
        self._words: asyncio.Queue[str] = asyncio.Queue()

    def tell(self, event: str, **values: Any) -> None:
        """Report `event`."""
        tell(event, **values)

    async def wait_for(self, word: str) -> None:
        """Wait for `word`; another word is an error."""
        came = await self.next_word()
        if came != word:
            raise ValueError(f"expected the word {word!r}, got {came!r}")

    async def next_word(self) -> str:
        """The next word."""
        return await self._words.get()

    async def listen(self) -> None:
        """Read its words until stdin ends."""
        reader = asyncio.StreamReader()
        transport, _ = await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(0, "rb", buffering=0)
        )
        try:
            while line := await reader.readline():
                self._words.put_nowait(line.decode().strip())
        finally:
            transport.close()


def tell(event: str, **values: Any) -> None:
    """Report `event` to the parent process."""
    sys.stdout.write(json.dumps({"event": event, **values}) + "\n")  # one write: forks may report, too
    sys.stdout.flush()


def run(
    main: Callable[[Parent], Awaitable[None]],
    *,
    life_s: int = LIFE_S,
    by: Callable[[Coroutine[Any, Any, None]], object] = uvloop.run,
) -> None:
    """Run `main` on the loop that the bus uses, or on another loop (`by`), until the parent closes stdin."""
    signal.alarm(life_s)
    gc.freeze()  # for all systems, because `bus.run` does it
    by(_serve(main))


def options(kind: type[Any]) -> Any:
    """The last argument of the command line, converted to the Struct `kind`."""
    return msgspec.json.decode(sys.argv[-1].encode(), type=kind)


async def _serve(main: Callable[[Parent], Awaitable[None]]) -> None:
    parent = Parent()
    work = asyncio.ensure_future(main(parent))
    end = asyncio.ensure_future(parent.listen())
    try:
        await asyncio.wait({work, end}, return_when=asyncio.FIRST_COMPLETED)
        if work.done():
            work.result()
            await end
    finally:
        for task in (work, end):
            task.cancel()
        await asyncio.gather(work, end, return_exceptions=True)
