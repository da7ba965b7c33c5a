"""YAML from the standard input, one document after the other, as they come.

Documents are separated by lines of `---`, as echo prints them; a line that is a JSON object is one by itself.
"""

import asyncio
import io
import sys
from collections.abc import AsyncIterator, Iterable, Iterator
from threading import Semaphore, Thread
from typing import Any

import yaml

from bus_cli.output import CommandError

_WAITING = 64


def load(text: str) -> Any:
    """One document. Raises CommandError where it is no YAML."""
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise CommandError(f"The passed value needs to be a dictionary in YAML format: {error}") from None


def split(lines: Iterable[str]) -> Iterator[str]:
    """The documents in `lines`; empty ones are left out."""
    document: list[str] = []
    for line in lines:
        is_object = not document and line.startswith("{") and line.rstrip().endswith("}")
        if is_object:
            yield line
        elif line.rstrip() != "---":
            document.append(line)
        elif "".join(document).strip():
            yield "".join(document)
            document = []
    if "".join(document).strip():
        yield "".join(document)


async def read_documents() -> AsyncIterator[Any]:
    """The documents on the standard input, each as soon as it is whole."""
    loop = asyncio.get_running_loop()
    arrived: asyncio.Queue[str | None] = asyncio.Queue()
    room = Semaphore(_WAITING)

    def read() -> None:
        try:
            if isinstance(sys.stdin, io.TextIOWrapper):
                sys.stdin.reconfigure(errors="replace")
            for document in split(sys.stdin):
                room.acquire()
                loop.call_soon_threadsafe(arrived.put_nowait, document)
            loop.call_soon_threadsafe(arrived.put_nowait, None)
        except RuntimeError:
            pass  # the loop ended first

    # A daemon, because nothing can wake a thread that waits for input.
    Thread(target=read, daemon=True).start()
    while (document := await arrived.get()) is not None:
        room.release()
        yield load(document)
