"""Callbacks of the C client that destroy, create and close, by both routes, with the sanitizers."""

import asyncio
import re
import signal
from pathlib import Path

import pytest

import bus
import c_programs
from conftest import Daemon
from programs import running_command
from semantics import node

__all__ = ["node"]


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


DESTROYED = ["answer 1: the client was destroyed", "call: the client was destroyed"]
STORIES = {
    "own": ["size 5, first byte 145", "heard 1", "heard 1 in all"],
    "idle": ["full: 1", "idle: 1", "heard 1 in all"],
    "wait": ["full: 1", "wait: 1: the publisher has ended", "heard 1 in all"],
    "calls": [*DESTROYED * 2, "heard 2 in all"],
    "many": ["call 0: the server has too many open calls", "heard 10001 in all"],
    "node": [*DESTROYED * 2, "heard 2 in all"],
    "close": ["connected: 1", "heard 1 in all"],
    "create": ["soon: 1", "heard 1 in all"],
    "names": [
        *["-22: the name of a node is not UTF-8"] * 2,
        "-22: the name of a topic is not UTF-8",
        "-22: Invalid topic name: topic name must not contain characters other than alphanumerics, "
        "'_', or '/':",
        "-22: a text, bytes or a list is longer than its type permits, or there is no memory",
        "heard 0 in all",
    ],
    "ping": ["enough: 1", "heard 0 in all"],
    "late": ["missed 1 by the publisher", "heard 1 in all"],
    "kept": ["kept", "heard 0 in all"],
    "fork": ["kept: 1", *DESTROYED * 2, "heard 2 in all"],
    "warm": [
        *(f"/{topic}: none for a message" for topic in ("heard", "taken", "lossless", "alive")),
        "heard 1200 in all",
    ],
    "poll": ["taken 100, ready without a message 0", "heard 0 in all"],
    "alive": [
        *(f"a publisher of /t is {state}" for state in ("alive", "not alive", "alive")),
        "heard 0 in all",
    ],
}


@pytest.mark.parametrize("story", STORIES)
async def test_callbacks(daemon: Daemon, programs: Path, tmp_path: Path, route: str, story: str) -> None:
    async with running_command(tmp_path, programs / "callbacks", story) as program:
        assert await program.end() == 0, program.lines
    assert program.lines == STORIES[story]


async def test_slots_of_readers_are_used_again(
    daemon: Daemon, programs: Path, tmp_path: Path, route: str
) -> None:
    async with running_command(tmp_path, programs / "callbacks", "slots") as program:
        assert await program.end() == 0, program.lines
    assert program.lines == [f"by ring {int(route == 'shm')}", "heard 0 in all"]


async def test_without_busd_it_sleeps_although_a_forked_child_has_the_socket(
    daemon: Daemon, programs: Path, tmp_path: Path
) -> None:
    async with running_command(tmp_path, programs / "callbacks", "away") as program:
        await program.line("^ready$")
        daemon.kill()
        found = await program.line(r"^ten turns in (\d+) ms$")
        assert await program.end() == 0, program.lines
    assert int(found[1]) > 500


async def test_the_event_of_a_new_connection_may_create(
    daemon: Daemon, programs: Path, tmp_path: Path, route: str
) -> None:
    async with running_command(tmp_path, programs / "callbacks", "again") as program:
        await program.line("^ready$")
        daemon.kill()
        daemon.restart()
        await program.line(f"^matched, by ring {int(route == 'shm')}$")
        assert await program.end() == 0, program.lines


async def test_an_endpoint_that_was_not_created_is_not_declared_later(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path
) -> None:
    async with running_command(tmp_path, programs / "callbacks", "phantom") as program:
        await program.line("^ready$")
        daemon.kill()
        await program.line("^phantom: 1$")
        daemon.restart()
        topics: set[str] = set()
        while "/full" not in topics:
            await asyncio.sleep(0.02)
            try:
                topics = {one.topic for one in (await node.graph()).publishers}
            except bus.errors.BusError:
                pass  # it is not connected again
        assert "/phantom" not in topics


async def test_a_reply_inside_of_a_reply(daemon: Daemon, programs: Path, tmp_path: Path) -> None:
    """By socket, the reply finds that busd has ended. Its event replies to the same call."""
    command = (programs / "callbacks", "reply")
    async with running_command(tmp_path, *command, BUS_ROUTE="socket") as program:
        await program.line("^ready$")
        daemon.kill()
        program.process.send_signal(signal.SIGUSR1)
        assert await program.end() == 0, program.lines
    assert program.lines[1:4] == ["reply in the event: 0", "reply: 0", "responses 1, open 0"]


async def test_a_call_inside_of_a_call(daemon: Daemon, programs: Path, tmp_path: Path) -> None:
    """By socket, the call finds that busd has ended. Its event calls, too; each call gets its answer."""
    command = (programs / "callbacks", "call")
    async with running_command(tmp_path, *command, BUS_ROUTE="socket") as program:
        await program.line("^ready$")
        daemon.kill()
        program.process.send_signal(signal.SIGUSR1)
        await program.line("^called$")
        daemon.restart()
        assert await program.end() == 0, program.lines
    assert sorted(program.lines[2:4]) == ["first: 1", "second: 2"]


async def test_nothing_waits_for_busd_if_the_program_wants_so(
    daemon: Daemon, programs: Path, tmp_path: Path, route: str
) -> None:
    """What busd has not answered yet may be destroyed, and busd forgets it."""
    async with running_command(tmp_path, programs / "callbacks", "at_once") as program:
        await program.line("^ready$")
        daemon.kill()
        program.process.send_signal(signal.SIGUSR1)
        await program.line("^created$")
        daemon.restart()
        assert await program.end() == 0, program.lines
    assert [re.sub(r"( name): .*", r"\1", line) for line in program.lines[1:]] == [
        "call: /add/_request has no server",
        "created",
        "refused: /a b: Invalid topic name",
        "refused: node a b: Invalid node name",
        "publish: 1",
        "node /callbacks",
        "node /early",
        "ended: 1",
        "heard 1 in all",
    ]
