"""What can be done to the processes of a bus: values."""

from dataclasses import dataclass
from typing import TypeAlias

from chaos.roles import Ear, Role, Talker

LEASE_S = 3.0
"""busd's, short enough that some who are stopped or asleep outlast it."""


@dataclass(frozen=True)
class Enter:
    role: Role


@dataclass(frozen=True)
class Kill:
    name: str


@dataclass(frozen=True)
class Leave:
    """It hands over what it has published, and ends in order."""

    name: str


@dataclass(frozen=True)
class Stop:
    name: str


@dataclass(frozen=True)
class Resume:
    name: str


@dataclass(frozen=True)
class Doze:
    """It is stopped, just after busd has heard of it."""

    name: str


@dataclass(frozen=True)
class Nap:
    """Its event loop stands still for so long."""

    name: str
    time_s: float


@dataclass(frozen=True)
class Remake:
    """One of its endpoints ends, and another like it comes."""

    name: str
    old: int
    new: Talker | Ear


@dataclass(frozen=True)
class Cut:
    """Its connection ends after so many more bytes."""

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
    """In order."""


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
"""Deeds with the time of each, in seconds from the storm's begin, in order."""
