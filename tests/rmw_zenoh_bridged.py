"""A bus, its bridge to ROS 2 on zenoh, a router, and a node of another program: what these tests share."""

import asyncio
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, NamedTuple

import pytest

from bridged_world import Bridge, Side, World
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bridge.ros2.service_types import ServiceTypes
from bus_bridge.ros2.type_names import type_to_dds
from bus_ros.cdr import Codec, codec_of
from forks import Forks
from peers.peer import PROGRAMS, Peer
from ports import free_port, own_domain

__all__ = ["Ros", "kind_of", "message_codec", "ros", "service_codecs", "service_kind", "why_not"]

_DOMAIN = own_domain()
_ROUTER = """
import sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"router"')
config.insert_json5("listen/endpoints", f'["{sys.argv[1]}"]')
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config):
    print("ready", flush=True)
    sys.stdin.read()
"""


def why_not() -> str:
    """Why there is no bridge to ROS 2 on zenoh; empty if there is one."""
    missing = [name for name in ("zenoh", "xxhash") if find_spec(name) is None]
    return f"{' and '.join(missing)} not installed: make setup installs them" if missing else ""


class Router:
    """A router of zenoh. It may end and come back at the same address."""

    def __init__(self, prefix: tuple[str, ...]) -> None:
        self.address = f"tcp/localhost:{free_port()}"
        self._command = (*prefix, sys.executable, "-c", _ROUTER, self.address)
        self.start()

    def start(self) -> None:
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


class Ros(NamedTuple):
    """The world of a test."""

    world: World
    router: Router

    @property
    def side(self) -> Side:
        return self.world["robot"]

    @property
    def domain(self) -> int:
        return _DOMAIN

    def bridge(self, *arguments: str, by: Literal["--connect", "--router"] = "--connect") -> Bridge:
        where = ("--rmw", "zenoh", by, self.router.address, "--domain-id", str(_DOMAIN))
        return self.side.bridge("ros2", "--id", "robot", *where, *arguments)

    def peer(self, name: str = "far", domain: int = _DOMAIN) -> Peer:
        """A node as rmw_zenoh makes it, written from its documents."""
        machine = self.side.machine
        command = (sys.executable, str(PROGRAMS / "rmw_zenoh.py"), name, self.router.address, str(domain))
        return Peer(command, None, machine)


@pytest.fixture
def ros(tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros]:
    """A bus with the name `robot`, and a router on its machine."""
    if reason := why_not():
        pytest.skip(reason)
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, "robot") as world:
        machine = world["robot"].machine
        router = Router(tuple(machine.prefix) if machine else ())
        try:
            yield Ros(world, router)
        finally:
            router.kill()


async def ask(peer: Peer, order: str, **arguments: Any) -> Any:
    """Does not block the nodes of this process."""
    return await asyncio.to_thread(peer.ask, order, **arguments)


def message_codec(type_name: str) -> Codec:
    return codec_of(MessageSchema.of(message_class(type_name)))


def kind_of(type_name: str) -> dict[str, str]:
    """A type of messages, as the peer wants it."""
    return {"type_name": type_to_dds(type_name), "type_hash": message_codec(type_name).type_hash}


def service_codecs(type_name: str) -> tuple[Codec, Codec]:
    """The codecs of a service's requests and answers."""
    types = ServiceTypes.find(type_name)
    return types.codecs


def service_kind(type_name: str) -> dict[str, str]:
    """A type of services, as the peer wants it."""
    types = ServiceTypes.find(type_name)
    return {"type_name": type_to_dds(type_name), "type_hash": types.type_hash}
