"""Possible events for the processes of a bus: values."""

from dataclasses import dataclass
from typing import TypeAlias

from chaos.roles import Ear, Role, Talker

LEASE_S = 3.0
"""busd's lease; short, so that some actors are stopped or asleep for longer."""


@dataclass(frozen=True)
class Enter:
    role: Role


@dataclass(frozen=True)
class Kill:
    name: str


@dataclass(frozen=True)
class Leave:
    """The actor hands over its published messages, and ends in order."""

    name: str


@dataclass(frozen=True)
class Stop:
    name: str


@dataclass(frozen=True)
class Resume:
    name: str


@dataclass(frozen=True)
class Doze:
    """The actor is stopped, just after busd has received data from it."""

    name: str


@dataclass(frozen=True)
class Nap:
    """The actor's event loop stands still for this time."""

    name: str
    time_s: float


@dataclass(frozen=True)
class Remake:
    """One of the actor's endpoints ends, and a similar one replaces it."""

    name: str
    old: int
    new: Talker | Ear


@dataclass(frozen=True)
class Cut:
    """The actor's connection ends after this many more bytes."""

    name: str
    after_bytes: int
    seed: int


@dataclass(frozen=True)
class KillBroker:
    pass


@dataclass(frozen=True)
class StartBroker:
    pass


@dataclass(frozen=True)
class RestartBroker:
    """Restart busd in order."""


@dataclass(frozen=True)
class StopBroker:
    pass


@dataclass(frozen=True)
class ResumeBroker:
    pass


Deed: TypeAlias = (
    Enter
    | Kill
    | Leave
    | Stop
    | Doze
    | Resume
    | Nap
    | Remake
    | Cut
    | KillBroker
    | StartBroker
    | RestartBroker
    | StopBroker
    | ResumeBroker
)
Script: TypeAlias = list[tuple[float, Deed]]
"""Deeds in order, each with its time in seconds from the beginning of the storm."""
