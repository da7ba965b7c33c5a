"""multiprocessing.Pipe, with its two ends in two processes that are not parent and child.

The subscriber blocks in `recv`, as a plain program does (`take_by` "blocking"), or calls it when its event
loop reports input.
"""

import asyncio
import os
import sys
from multiprocessing.connection import Client, Listener
from pathlib import Path

from benchmarks.adapters import roles
from benchmarks.work import Work
from benchmarks.worker import Parent, options, run


def _path() -> str:
    return str(Path(os.environ["BENCH_FOLDER"]) / "pipe.sock")


async def publisher(parent: Parent) -> None:
    with Client(_path()) as connection:
        await roles.publish(parent, options(Work), connection.send)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    taker = roles.Taker(parent, work)
    with Listener(_path()) as listener:
        parent.tell("ready")
        connection = listener.accept()
    take, receive = taker.take, connection.recv
    if work.take_by == "blocking":
        roles.take_in_thread(taker, receive)
    else:
        asyncio.get_running_loop().add_reader(connection.fileno(), lambda: take(receive()))
    await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
