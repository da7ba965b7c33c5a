"""A minimal Python program: a word and payloads in a memfd, and an eventfd that wakes the reader's uvloop.

The word counts the written messages. It has no framing, no types, no discovery and no check that the reader
keeps up. Only the processor orders the accesses to memory. Paced only.
"""

import asyncio
import mmap
import os
import socket
import struct
import sys
from pathlib import Path

from benchmarks.adapters import roles
from benchmarks.work import Work
from benchmarks.worker import Parent, options, run

_WORD = struct.Struct("<Q")
_PLACES = 1000
"""Messages of one second: enough if the scheduler does not run the reader for a while."""


def _path() -> str:
    return str(Path(os.environ["BENCH_FOLDER"]) / "floor.sock")


def _place(number: int, size: int) -> int:
    return _WORD.size + number % _PLACES * size


def _end(size: int) -> int:
    return _WORD.size + _PLACES * size


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sock:
        sock.connect(_path())
        _, (memory, bell), _, _ = socket.recv_fds(sock, 1, 2)
    size = work.size
    with mmap.mmap(memory, _end(size)) as segment:
        pack, ring, count = _WORD.pack_into, os.eventfd_write, 0

        def send(text: str) -> None:
            nonlocal count
            place = _place(count, size)
            segment[place : place + size] = text.encode()
            count += 1
            pack(segment, 0, count)
            ring(bell, 1)

        await roles.publish(parent, work, send)


async def subscriber(parent: Parent) -> None:
    work: Work = options(Work)
    taker = roles.Taker(parent, work)
    loop = asyncio.get_running_loop()
    size = work.size
    memory = os.memfd_create("floor")
    os.ftruncate(memory, _end(size))
    bell = os.eventfd(0, os.EFD_NONBLOCK)
    with mmap.mmap(memory, _end(size)) as segment:
        unpack, read, take, taken = _WORD.unpack_from, os.read, taker.take, 0

        def wake() -> None:
            nonlocal taken
            read(bell, _WORD.size)
            (count,) = unpack(segment, 0)
            while taken < count:
                place = _place(taken, size)
                take(segment[place : place + size].decode())
                taken += 1

        loop.add_reader(bell, wake)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
            server.bind(_path())
            server.listen()
            server.setblocking(False)
            parent.tell("ready")
            connection, _ = await loop.sock_accept(server)
            with connection:
                socket.send_fds(connection, [b"!"], [memory, bell])
        await taker.finish()


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
