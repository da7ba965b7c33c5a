"""YAML documents from the standard input, read one by one as they arrive.

Lines of `---` separate documents, as in the output of echo. A line with a JSON object is a document by
itself.
"""

import asyncio
import io
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import AsyncIterator, Iterable, Iterator
from threading import Semaphore, Thread
from typing import Any

import yaml

from bus_cli.output import CommandError

_WAITING = 64


def load(text: str) -> Any:
    """The value of one document. Raises CommandError if it is not YAML."""
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise CommandError(f"The passed value needs to be a dictionary in YAML format: {error}") from None


def add_values_arguments(parser: ArgumentParser, name: str, help_: str, *, stdin_help: str) -> None:
    """Add the argument for a value in YAML, and the option `--stdin`; `given_value` reads them."""
    parser.add_argument(name, nargs="?", help=help_)
    parser.add_argument("--stdin", action="store_true", help=stdin_help)
    parser.set_defaults(usage=parser.error, values_name=name)


def given_value(args: Namespace) -> Any:
    """The value on the command line or the whole standard input; {} if there is none.

    Raises CommandError if it is not YAML.
    """
    text: str | None = getattr(args, args.values_name)
    if text is not None and args.stdin:
        args.usage(f"argument --stdin: not allowed with argument {args.values_name}")
    if args.stdin:
        if isinstance(sys.stdin, io.TextIOWrapper):
            sys.stdin.reconfigure(errors="replace")
        text = sys.stdin.read()
    value = load(text or "{}")
    return {} if value is None else value


def split(lines: Iterable[str]) -> Iterator[str]:
    """The documents in `lines`, without empty ones."""
    document: list[str] = []
    for line in lines:
        is_object = not document and line.startswith("{") and line.rstrip().endswith("}")
        if is_object:
            yield line
        elif not document and not line.strip():
            continue  # it begins no document, so JSON may follow
        elif line.rstrip() != "---":
            document.append(line)
        elif "".join(document).strip():
            yield "".join(document)
            document = []
    if "".join(document).strip():
        yield "".join(document)


async def read_documents() -> AsyncIterator[Any]:
    """The documents on the standard input, each as soon as it is complete."""
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
            pass  # the loop ended before the input

    # A daemon thread, because a thread that waits for input can't be woken.
    Thread(target=read, daemon=True).start()
    while (document := await arrived.get()) is not None:
        room.release()
        yield load(document)
