"""The measured hostile programs, by the names of their rows."""

from functools import partial
from typing import NamedTuple

from benchmarks.adapters.hostile.attack import Attack

QUIET = "quiet"
BUSY = "a busy loop"
GUEST = 54322
"""The id of a user without any other process."""

_GUESTS = f"""
[socket]
mode = 0o666

[[access]]
users = [{GUEST}]
topics = "/**"
actions = ["publish", "subscribe", "observe"]
"""


class Neighbour(NamedTuple):
    """The programs beside the pair. `rules` is busd's configuration; `is_floor`: they ask nothing of busd."""

    attacks: tuple[Attack, ...] = ()
    rules: str = ""
    is_floor: bool = False


def _one(attack: Attack) -> Neighbour:
    return Neighbour((attack,))


def _guest(attack: Attack) -> Neighbour:
    return Neighbour((attack,), _GUESTS)


_busy, _as_guest = Attack("busy loop"), partial(Attack, uid=GUEST)

NEIGHBOURS: dict[str, Neighbour] = {
    QUIET: Neighbour(is_floor=True),
    BUSY: Neighbour((_busy,), is_floor=True),
    "two busy loops": Neighbour((_busy, _busy), is_floor=True),
    "two that talk by a socket": Neighbour((Attack("socket"),), is_floor=True),
    "samples": _one(Attack("runs")),
    "one-byte runs": _one(Attack("runs", samples=1, size=1)),
    "samples of 1 MiB": _one(Attack("runs", samples=1, size=1 << 20)),
    "samples by shared memory": _one(Attack("shared memory")),
    "acks": _one(Attack("acks")),
    "acks from 8 connections": _one(Attack("acks", connections=8)),
    "acks from 40 connections": _one(Attack("acks", connections=40)),
    "reports from 40 connections": _one(Attack("reports", connections=40)),
    "signs of life from 40 connections": _one(Attack("signs of life", connections=40)),
    "attaches from 40 connections": _one(Attack("attaches", connections=40)),
    "pings from 40 connections": _one(Attack("pings", connections=40)),
    "questions": _one(Attack("questions")),
    "questions about 2,000 endpoints": _one(Attack("questions", number=2000)),
    "observers that come and go": _one(Attack("observers", number=2000)),
    "endpoints that come and go": _one(Attack("endpoints")),
    "the same before 40 observers": _one(Attack("endpoints", connections=41)),
    "types": _one(Attack("types", number=1000, size=500)),
    "62,500 matches": _one(Attack("matches", number=500)),
    "3 times 21,000 matches": _one(Attack("matches", number=290, connections=3)),
    "62,500 pairs that don't match": _one(Attack("incompatible", number=500)),
    "1,000 leases that flap": _one(Attack("flapping", number=1000)),
    "4,096 replays": _one(Attack("replays", number=4096, samples=100)),
    "rings for 1,000 subscriptions": _one(Attack("rings", number=1000)),
    "a reader of single bytes": _one(Attack("slow reader")),
    "32 subscriptions of everything": _one(Attack("everything", number=32)),
    "4,000 subscriptions of everything": _one(Attack("everything", number=4000)),
    "connections": _one(Attack("connections")),
    "connections with garbage": _one(Attack("garbage")),
    "a guest's endpoints": _guest(_as_guest("endpoints")),
    "a guest's questions": _guest(_as_guest("questions", number=2000)),
    "a guest's 62,500 matches": _guest(_as_guest("matches", number=500)),
}
"""Each is one program, which does one thing as fast as busd lets it."""

ESSENTIAL = (
    QUIET,
    BUSY,
    "samples",
    "acks from 8 connections",
    "questions",
    "62,500 matches",
    "connections with garbage",
)
"""The neighbours of a quick run."""
