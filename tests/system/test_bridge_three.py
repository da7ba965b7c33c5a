"""Three buses joined by zenoh, in a star and in a ring: each message reaches all buses once."""

import asyncio
from collections.abc import Iterator
from contextlib import AsyncExitStack
from itertools import permutations
from pathlib import Path

import pytest

import bus
from bridged_world import Stream, World, on_one_loop, until
from bus.msg.std_msgs import String
from forks import Forks

pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed: make setup installs it")
pytestmark = pytest.mark.nightly

NAMES = ("hub", "left", "right")
TRANSIT = '[[bridge.zenoh.topics]]\npattern = "/**"\ntransit = true\n'


@pytest.fixture
def world(tmp_path: Path, forks: Forks, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with World(tmp_path, forks, *NAMES) as world:
        yield world


def _join(world: World, links: tuple[tuple[str, str], ...], *more: str, hub: tuple[str, ...] = ()) -> None:
    """One bridge on each bus; in each link the second connects to the first. `hub`: options for that one."""
    words: dict[str, list[str]] = {name: ["--insecure", *more] for name in NAMES}
    for one, other in links:
        endpoint = world.lay(one, other)
        words[one] += ["--listen", endpoint]
        words[other] += ["--connect", endpoint]
    words["hub"] += hub
    for name, arguments in words.items():
        world[name].bridge("zenoh", *arguments)


async def _all_hear_all(world: World, count: int = 50) -> None:
    """A talker on each bus; the other two buses receive each of its messages once, in order."""
    async with AsyncExitStack() as stack:
        nodes = {name: await stack.enter_async_context(world[name].node(f"of_{name}")) for name in NAMES}
        streams = [
            await stack.enter_async_context(
                Stream.open(f"/from_{one}_to_{other}", nodes[one], nodes[other], hz=100)
            )
            for one, other in permutations(NAMES, 2)
        ]
        for stream in streams:
            await until(lambda stream=stream: len(stream.heard) >= count, stream.topic)
        for stream in streams:
            await stream.stop()
            stream.say()
            await stream.arrived()
            assert stream.check() == 0 and len({info.publisher_gid for info in stream.infos}) == 1
        for name in NAMES:  # each far publisher has one mirror
            graph = world[name].graph()
            for one, other in permutations(NAMES, 2):
                assert len(graph.publishers_of(f"/from_{one}_to_{other}")) == 1, (name, one, other)


@on_one_loop
async def test_a_ring_in_which_each_is_joined_to_each(world: World) -> None:
    _join(world, (("hub", "left"), ("left", "right"), ("right", "hub")))
    await _all_hear_all(world)


@on_one_loop
async def test_a_star_without_transit_keeps_its_ends_apart(world: World) -> None:
    _join(world, (("hub", "left"), ("hub", "right")))
    async with world["left"].node("talker") as node, world["hub"].node("hub_talker") as hub:
        await node.create_publisher(String, "/left", 10)
        await hub.create_publisher(String, "/hub", 10)
        await world["hub"].shows(lambda graph: graph.publishers_of("/left"))
        await world["right"].shows(lambda graph: graph.publishers_of("/hub"))
        assert not world["right"].graph().publishers_of("/left")


@pytest.mark.parametrize("shape", ["star", "ring"])
@on_one_loop
async def test_with_transit_what_came_goes_on_and_never_round(
    world: World, tmp_path: Path, shape: str
) -> None:
    config = tmp_path / "transit.toml"
    config.write_text(TRANSIT)
    rules = ("--config", str(config))
    if shape == "ring":
        _join(world, (("hub", "left"), ("hub", "right"), ("left", "right")), *rules)
    else:  # a rule at the hub is enough
        _join(world, (("hub", "left"), ("hub", "right")), hub=rules)
    await _all_hear_all(world)


@on_one_loop
async def test_two_latched_publishers_reach_a_late_joiner_through_the_hub(
    world: World, tmp_path: Path
) -> None:
    config = tmp_path / "transit.toml"
    config.write_text(TRANSIT)
    _join(world, (("hub", "left"), ("hub", "right")), "--config", str(config))
    latched = bus.QoSProfile(1, durability="transient_local")
    async with world["left"].node("one") as one, world["hub"].node("other") as other:
        for node in (one, other):
            publisher = await node.create_publisher(String, "/tf_static", latched)
            publisher.publish(String(data=node.name))
        heard: list[str] = []
        async with world["right"].node("late") as late:
            await world["right"].shows(lambda graph: len(graph.publishers_of("/tf_static")) == 2)
            await late.create_subscription(String, "/tf_static", latched, lambda one: heard.append(one.data))
            await until(lambda: len(heard) == 2)
            await asyncio.sleep(0)
            assert sorted(heard) == ["one", "other"]
