"""`bus bridge zenoh --router`: buses joined by a zenoh router, which starts late and is restarted."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AsyncExitStack, ExitStack, contextmanager
from pathlib import Path

import pytest

from bridged_world import Bridge, Stream, World, on_one_loop, until
from bus_bridge.zenoh.options import parse_address
from certificates import make_certificates
from forks import Forks

pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed: make setup installs it")

SIDES = ("robot", "laptop")
ROUTER = """
import json, sys, zenoh
config = zenoh.Config()
for name, value in json.loads(sys.argv[1]).items():
    config.insert_json5(name, json.dumps(value))
with zenoh.open(config):
    print("ready", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def world(tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, "base", *SIDES) as world:
        yield world


class Router:
    """zenohd of the package zenoh, on the machine `base`, with an address for each side."""

    def __init__(self, world: World, protocol: str = "tcp", sides: tuple[str, ...] = SIDES) -> None:
        self._machine = world["base"].machine
        self.addresses = {name: world.lay("base", name).replace("tcp/", f"{protocol}/") for name in sides}
        self.settings: dict[str, object] = {
            "mode": "router",
            "scouting/multicast/enabled": False,
            "listen/endpoints": [*self.addresses.values()],
        }

    @property
    def hosts(self) -> list[str]:
        return [parse_address(one).host for one in self.addresses.values()]

    @contextmanager
    def running(self) -> Iterator[None]:
        prefix = self._machine.prefix if self._machine else ()
        command = (*prefix, sys.executable, "-c", ROUTER, json.dumps(self.settings))
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            try:
                assert process.stdout.readline() == "ready\n"
                yield
            finally:
                process.kill()


def join(world: World, router: Router, *more: str) -> list[Bridge]:
    return [
        world[name].bridge("zenoh", "--id", name, "--router", router.addresses[name], *more) for name in SIDES
    ]


async def say_and_hear(world: World) -> None:
    """In both directions, every message arrives once and in order."""
    robot, laptop = SIDES
    async with (
        world[robot].node("robot_node") as one,
        world[laptop].node("laptop_node") as other,
        Stream.open("/there", one, other) as there,
        Stream.open("/back", other, one) as back,
    ):
        for stream in (there, back):
            await until(lambda stream=stream: len(stream.heard) > 50, stream.topic)
            await stream.stop()
            stream.say()
            await stream.arrived()
            assert stream.check() == 0


@on_one_loop
async def test_what_is_said_crosses_by_a_router(world: World) -> None:
    router = Router(world)
    with router.running():
        one, other = join(world, router, "--insecure")
        await say_and_hear(world)
        links = {
            (link["address"], link["state"], link["bus"], link["text"]) for link in one.status()["links"]
        }
        assert links == {
            (router.addresses["robot"], "up", "", "a router"),
            ("by a router", "up", "laptop", ""),
        }
        one.end()
        other.end()
        for side in world.sides:
            await until(lambda side=side: not side.names())


@on_one_loop
async def test_a_router_that_is_not_there_yet_is_waited_for(world: World) -> None:
    router = Router(world)
    one, _ = join(world, router, "--insecure")
    told = f"--router {router.addresses['robot']}: connection refused; still trying"
    await until(lambda: told in one.log.read_text())
    (link,) = one.status()["links"]
    assert (link["state"], link["text"]) == ("trying", "connection refused")
    with router.running():
        await say_and_hear(world)
    assert one.log.read_text().count(told) == 1


@on_one_loop
async def test_a_bridge_ends_though_no_router_is_there(world: World) -> None:
    for bridge in join(world, Router(world), "--insecure"):
        await until(lambda bridge=bridge: "connecting to the router at" in bridge.log.read_text())
        bridge.end()


@on_one_loop
async def test_a_router_is_restarted(world: World) -> None:
    router = Router(world)
    with ExitStack() as first:
        first.enter_context(router.running())
        join(world, router, "--insecure")
        async with (
            world["robot"].node("talker") as talker,
            world["laptop"].node("listener") as listener,
            Stream.open("/chatter", talker, listener) as stream,
        ):
            await stream.flows()
            first.close()
            await world["laptop"].shows(lambda graph: not graph.publishers_of("/chatter"))
            with router.running():
                await stream.flows()
                await stream.stop()
                stream.say()
                await stream.arrived()
                stream.check()


@on_one_loop
async def test_a_bridge_that_takes_a_router_for_a_bridge_is_told(world: World) -> None:
    router = Router(world)
    address = router.addresses["robot"]
    with router.running():
        bridge = world["robot"].bridge("zenoh", "--connect", address, "--insecure")
        told = (
            f"--connect {address}: that is a router of zenoh, not a bridge; to reach others through it, use "
            f"--router {address}"
        )
        await until(lambda: told in bridge.log.read_text())


@on_one_loop
async def test_with_certificates_of_both_sides(world: World, tmp_path: Path) -> None:
    router = Router(world, "tls")
    made = make_certificates(tmp_path, "base", "peer", addresses=router.hosts)
    base, peer = made["base"], made["peer"]
    tls = "transport/link/tls"
    router.settings |= {
        f"{tls}/root_ca_certificate": str(base.ca),
        f"{tls}/enable_mtls": True,
        f"{tls}/listen_private_key": str(base.key),
        f"{tls}/listen_certificate": str(base.certificate),
    }
    files = ("--ca", str(peer.ca), "--certificate", str(peer.certificate), "--key", str(peer.key))
    with router.running():
        join(world, router, *files)
        await say_and_hear(world)


@on_one_loop
async def test_groups_of_a_fleet(tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots see their operators, not each other. A bus in no group is not seen by buses that choose."""
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    chosen = ("--group", "robots", "--see", "operators")
    groups: dict[str, tuple[str, ...]] = {
        "robot": chosen,
        "second": chosen,
        "operator": ("--group", "operators"),
        "guest": (),
    }
    with World(tmp_path, forks, "base", *groups) as world, ExitStack() as stack:
        router = Router(world, sides=tuple(groups))
        stack.enter_context(router.running())
        bridges = {
            name: world[name].bridge(
                "zenoh", "--id", name, "--router", router.addresses[name], "--insecure", *options
            )
            for name, options in groups.items()
        }
        async with AsyncExitStack() as nodes:
            made = {name: await nodes.enter_async_context(world[name].node(f"of_{name}")) for name in groups}
            there = await nodes.enter_async_context(Stream.open("/there", made["robot"], made["operator"]))
            back = await nodes.enter_async_context(Stream.open("/back", made["operator"], made["robot"]))
            for stream in (there, back):
                await until(lambda stream=stream: len(stream.heard) > 20, stream.topic)
            for name, seen in {
                "operator": {"/of_robot", "/of_second", "/of_guest"},
                "robot": {"/of_operator"},
                "second": {"/of_operator"},
                "guest": {"/of_operator"},
            }.items():
                await world[name].shows(
                    lambda graph, seen=seen: seen <= {node.full_name for node in graph.nodes}
                )
                others = {f"/of_{other}" for other in groups} - seen - {f"/of_{name}"}
                assert not others & world[name].names(), name
            why = "its --see does not name the group of this bus (--group)"
            await until(
                lambda: (
                    {"robot", "second"}
                    == {link["bus"] for link in bridges["guest"].status()["links"] if link["text"] == why}
                )
            )
            assert {link["bus"] for link in bridges["robot"].status()["links"]} == {"", "operator"}
        said = bridges["robot"].log.read_text()
        assert "in the group 'robots', sees operators" in said


def test_a_wrong_name_of_a_group(world: World) -> None:
    found = world["robot"].bus("bridge", "zenoh", "--group", "my robots")
    assert found.code == 1 and "--group: the name of a group has letters" in found.err
