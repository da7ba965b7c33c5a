"""Attacks with few frames that cause much work: many subscriptions for one frame, leases, slow readers."""

import fcntl
import os
from contextlib import ExitStack
from itertools import count

from benchmarks.adapters.hostile.attack import Attack
from benchmarks.adapters.hostile.pump import Feed, Pump, repeated
from benchmarks.adapters.hostile.raw import TYPE, Client, Fields, control, endpoint, records, run
from benchmarks.adapters.hostile.tally import Tally

_TOPIC = "/hostile"
_BATCH = 100
_LISTENERS = 20
_RINGS = 20
_LEASE_S = 0.01
_RING_BYTES = 128 << 10
_FUTURE_WRITE = 0x10  # F_SEAL_FUTURE_WRITE; Python has it since 3.13
_SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL | _FUTURE_WRITE


def flapping(attack: Attack, tally: Tally) -> None:
    """Let the tiny leases of `number` publishers of one topic expire, and renew all of them at once."""
    lease = {"liveliness": "manual_by_topic", "liveliness_lease_duration": _LEASE_S}
    with Client() as talker, Client() as listener:
        _subscribe(listener, _LISTENERS)
        node = talker.node()
        made = []
        for _ in range(0, attack.number, _BATCH):
            answers = talker.ask(*[("pub+", endpoint(node, _TOPIC, lease)) for _ in range(_BATCH)])
            made += [answer["id"] for answer in answers if answer["m"] == "created"]
        signs = b"".join(control("alive", publisher=number) for number in made)
        while True:
            talker.write(signs)
            for client in (talker, listener):
                client.barrier()
            if not tally.add(len(made), wait_s=2 * _LEASE_S):
                return


def replays(attack: Attack, tally: Tally) -> None:
    """Let `number` subscriptions get a publisher's history, close them, and repeat."""
    durable = {"durability": "transient_local", "depth": attack.samples}
    with Client() as talker:
        number = talker.publisher(endpoint(talker.node(), _TOPIC, durable))
        talker.write(run(number, 1, attack.samples, records([b"x" * attack.size] * attack.samples)))
        while True:
            with Client() as listener:
                _subscribe(listener, attack.number, durable)
                listener.barrier()
            talker.barrier()
            if not tally.add(attack.number):
                return


def rings(attack: Attack, tally: Tally) -> None:
    """Let a publisher with `number` subscriptions by shared memory change its ring, again and again."""
    with ExitStack() as stack:
        talker, listener = (stack.enter_context(Client()) for _ in range(2))
        descriptors = [os.eventfd(0, os.EFD_CLOEXEC | os.EFD_NONBLOCK), *(_memory() for _ in range(2))]
        for one in descriptors:
            stack.callback(os.close, one)
        doorbell, readers, ring = descriptors
        for client in (talker, listener):
            client.carry(control("share", descriptors=2), doorbell, readers)
        _subscribe(listener, attack.number)
        fields = endpoint(talker.node(), _TOPIC, descriptors=1)
        talker.carry(control("pub+", request=0, **fields), ring)
        (answer,) = talker.answers([0])
        number = int(answer["id"])
        while True:
            for _ in range(_RINGS):
                talker.carry(control("ring", publisher=number, descriptors=1), ring)
            for client in (talker, listener):
                client.barrier()
            if not tally.add(_RINGS):
                return


def slow_reader(attack: Attack, tally: Tally) -> None:
    """Request the graph and receive samples all the time, but read byte by byte."""
    with Client() as client, Client() as talker:
        _subscribe(client, _BATCH)
        number, seqs = talker.publisher(endpoint(talker.node(), _TOPIC)), count(1)
        body = records([b"x" * attack.size])
        question = control("graph?", request=1, statistics=True)
        samples = Feed(
            talker, lambda: b"".join(run(number, next(seqs), 1, body) for _ in range(_BATCH)), _BATCH
        )
        Pump([samples, repeated(client, question, 1)], read_bytes=1).run(tally)


def everything(attack: Attack, tally: Tally) -> None:
    """Subscribe `number` times to all existing topics, and read nothing."""
    with Client() as client:
        (graph,) = client.ask(("graph?", {"statistics": False}))
        node = client.node()
        for one in graph["endpoints"]:
            if one["kind"] != "publisher":
                continue
            kind = {key: one[key] for key in TYPE}
            client.send("type", **kind, schema=b"\xc0")
            asked: Fields = endpoint(node, one["topic"], {"reliability": "best_effort"}, **kind)
            for _ in range(attack.number):
                client.subscription({**asked, "gid": os.urandom(16)})
        sleeper = Pump([], sleepers=[client])
        sleeper.run(tally)


def _subscribe(client: Client, number: int, qos: Fields | None = None) -> None:
    """Declare `number` subscriptions of one topic."""
    node = client.node()
    for begin in range(0, number, _BATCH):
        fields = [endpoint(node, _TOPIC, qos) for _ in range(min(_BATCH, number - begin))]
        client.ask(*(("sub+", one) for one in fields))


def _memory() -> int:
    """Make a memfd that busd accepts for a ring or for a readers' segment."""
    number = os.memfd_create("busd-bench", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.posix_fallocate(number, 0, _RING_BYTES)
    fcntl.fcntl(number, fcntl.F_ADD_SEALS, _SEALS)
    return number
