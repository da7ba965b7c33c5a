"""Attacks with things that come and go all the time: endpoints, matches, types, connections."""

import contextlib
import os
import random
import socket
import struct
from contextlib import ExitStack
from itertools import count

from benchmarks.adapters.hostile.attack import Attack
from benchmarks.adapters.hostile.raw import TYPE, Client, Fields, control, endpoint
from benchmarks.adapters.hostile.tally import Tally

_BATCH = 64
_HELD = 50
_TIMEOUT_S = 0.2


def endpoints(attack: Attack, tally: Tally) -> None:
    """Declare many publishers at once, await each, and end them. All further connections watch the graph."""
    with Client() as client, ExitStack() as stack:
        watchers = [stack.enter_context(Client()) for _ in range(attack.connections - 1)]
        for watcher in watchers:
            watcher.send("observe", request=1, on=True)
        node, numbers = client.node(), count()
        while True:
            fields = [endpoint(node, f"/hostile_{next(numbers) % 100}") for _ in range(_BATCH)]
            answers = client.ask(*(("pub+", one) for one in fields))
            made = [answer["id"] for answer in answers if answer["m"] == "created"]
            client.write(b"".join(control("end-", endpoint=number) for number in made))
            for watcher in watchers:
                watcher.write_some(_PING)
                watcher.forget()
            if not tally.add(_BATCH + len(made), _BATCH - len(made)):
                return


def matches(attack: Attack, tally: Tally) -> None:
    """Declare `number` endpoints of one topic at once in each connection, close all at once, and repeat."""
    _crowd(attack, tally, {}, {})


def incompatible(attack: Attack, tally: Tally) -> None:
    """As `matches`, but no publisher offers the requested QoS, and busd reports that to both ends."""
    _crowd(attack, tally, {"reliability": "best_effort"}, {})


def _crowd(attack: Attack, tally: Tally, offered: Fields, requested: Fields) -> None:
    while True:
        with ExitStack() as stack:
            for index in range(attack.connections):
                client = stack.enter_context(Client())
                node = client.node()
                kinds = (("pub+", offered), ("sub+", requested))
                requests = [
                    control(tag, request=number, **endpoint(node, f"/crowd_{index}", qos))
                    for number, (tag, qos) in zip(range(attack.number), kinds * attack.number, strict=False)
                ]
                client.write(b"".join(requests))
                client.barrier()
        if not tally.add(attack.connections * attack.number):
            return


def types(attack: Attack, tally: Tally) -> None:
    """Declare `number` types of `size` bytes, disconnect, and repeat."""
    schema, numbers = bytes(attack.size), count()
    while True:
        with Client() as client:
            names = [f"hostile/msg/Type{next(numbers)}" for _ in range(attack.number)]
            for name in names:
                client.send("type", **{**TYPE, "type_name": name}, schema=schema)
            client.barrier()
        if not tally.add(attack.number):
            return


def connections(attack: Attack, tally: Tally) -> None:
    """Connect, exchange Hello with busd, and disconnect."""
    while True:
        with Client():
            pass
        if not tally.add(1):
            return


def garbage(attack: Attack, tally: Tally) -> None:
    """Connect and send invalid or incomplete frames, or descriptors, and usually disconnect."""
    chance = random.Random(1)
    held: list[socket.socket] = []
    for number in count():
        is_in = False
        client = socket.socket(socket.AF_UNIX)
        client.settimeout(_TIMEOUT_S)
        with client, contextlib.suppress(OSError):
            client.connect(os.environ["BUSD_SOCKET"])
            is_in = True
            if _insult(client, number % 6, chance):
                held.append(client.dup())
        if len(held) > _HELD:
            held.pop(0).close()
        if not tally.add(is_in, not is_in):
            return


def _insult(client: socket.socket, kind: int, chance: random.Random) -> bool:
    """Send one of six invalid things; returns whether to stay connected."""
    match kind:
        case 0:
            client.sendall(chance.randbytes(chance.randrange(1, 5000)))
        case 1:
            client.sendall(struct.pack("<I", 0xFFFFFFFF) + b"x" * 100)
        case 2:
            client.sendall(struct.pack("<I", 0))
        case 3:
            client.sendall(struct.pack("<I", 1000) + b"y" * 10)
        case 4:
            client.sendall(b"GET / HTTP/1.1\r\n\r\n")
        case _:
            ours, others = socket.socketpair()
            with ours, others:
                socket.send_fds(client, [chance.randbytes(64)], [ours.fileno(), others.fileno()])
    return kind == 3


_PING = control("ping", number=0)
