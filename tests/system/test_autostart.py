"""No busd runs: the first program starts one, and exactly one, also if several programs start at once."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

import bus
import bus.link.autostart
from bus.msg.std_msgs import Int32
from conftest import WAIT_S, open_descriptors
from effort import examples
from neighbours import wait_until
from semantics import until

IDLE_S = 2
"""Longer than a busy machine may delay the first connection of the program that starts busd."""

MEETING = """
import asyncio, sys
import bus
import bus.link.autostart
from bus.msg.std_msgs import String

bus.link.autostart.start.__defaults__ = (("--idle-exit", sys.argv[3]),)

async def main():
    mine, number = sys.argv[1], int(sys.argv[2])
    async with bus.Node(mine, arguments=[], rosout=False) as node:
        subscription = await node.create_subscription(String, "meeting", 1000)
        publisher = await node.create_publisher(String, "meeting", 1000)
        print((await node.graph()).broker_pid, flush=True)
        await publisher.wait_for_subscriptions(number)
        await subscription.wait_for_publishers(number)
        publisher.publish(String(data=mine))
        heard = set()
        async for message in subscription:
            heard.add(message.data)
            if len(heard) == number:
                break
        print("met", flush=True)
        await asyncio.to_thread(sys.stdin.read)

bus.run(main())
"""


def daemons(path: Path) -> set[int]:
    """The processes that serve, or want to serve, the socket."""
    found = set()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            arguments = (process / "cmdline").read_bytes().split(b"\0")
            if b"busd" in arguments and os.fsencode(path) in arguments:
                found.add(int(process.name))
    return found


@pytest.fixture(autouse=True)
def path(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A path without a server; at the end, kills the daemons started there."""
    monkeypatch.delenv("BUSD_AUTOSTART")
    monkeypatch.setattr(bus.link.autostart.start, "__defaults__", (("--idle-exit", str(IDLE_S)),))
    yield socket_path
    for pid in daemons(socket_path):
        with suppress(ProcessLookupError):  # it was about to end
            os.kill(pid, signal.SIGKILL)
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def meet(number: int, *, idle_s: float = 30) -> list[subprocess.Popen[str]]:
    return [
        subprocess.Popen(
            [sys.executable, "-c", MEETING, f"node{index}", str(number), str(idle_s)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for index in range(number)
    ]


def read_line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def part(processes: list[subprocess.Popen[str]]) -> None:
    for process in processes:
        _, errors = process.communicate(timeout=WAIT_S)
        assert (process.returncode, errors) == (0, "")


def test_several_at_once(path: Path) -> None:
    processes = meet(2 + examples(6), idle_s=IDLE_S)
    (broker,) = {int(read_line(process)) for process in processes}
    assert {read_line(process) for process in processes} == {"met"}
    wait_until(lambda: daemons(path) == {broker})
    part(processes)
    wait_until(lambda: not daemons(path))
    assert not path.exists()
    log = path.with_suffix(".log").read_text()
    said = ("[INFO]", "busd: busd is already running on")
    assert all(line.startswith(said) for line in log.splitlines()[1:]), log
    assert f"stopped: idle for {IDLE_S} s" in log
    assert "Traceback" not in log


def test_after_a_kill_they_start_another(path: Path) -> None:
    processes = meet(3)
    (broker,) = {int(read_line(process)) for process in processes}
    assert {read_line(process) for process in processes} == {"met"}
    os.kill(broker, signal.SIGKILL)
    (fourth,) = meet(1)
    second = int(read_line(fourth))
    assert second != broker
    fourth.kill()
    fourth.communicate()
    wait_until(lambda: daemons(path) == {second})
    for process in processes:
        assert process.stderr is not None
        assert "lost busd" in process.stderr.readline()
        for line in process.stderr:  # first "not back yet", perhaps; then "is back"
            if "busd is back" in line:
                break
        assert f"busd is back (pid {second})" in line
    part(processes)


def test_it_does_not_die_with_who_started_it(path: Path) -> None:
    """The daemon survives the end of that program and a Ctrl-C in its terminal."""
    (process,) = meet(1)
    broker = int(read_line(process))
    assert os.getsid(broker) == broker
    assert os.getpgid(broker) == broker
    process.kill()
    process.communicate()
    (another,) = meet(1)
    assert int(read_line(another)) == broker
    part([another])


async def test_not_where_it_is_turned_off(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    with pytest.raises(bus.BrokerUnavailable) as caught:
        await bus.Node("alone", arguments=[]).open()
    assert str(caught.value) == (
        f"no busd listens on {path}; start one with: busd --socket {path}"
        " (or let programs start it: unset BUSD_AUTOSTART)"
    )
    assert not daemons(path)


async def test_a_failed_start_leaves_no_descriptor(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program may try again for ever in one event loop."""
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    before = open_descriptors()
    for _ in range(3):
        with pytest.raises(bus.BrokerUnavailable):
            await bus.Node("alone", arguments=[]).open()
    assert open_descriptors() == before


async def test_in_a_folder_that_is_not_there_yet(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("BUSD_SOCKET")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    async with asyncio.timeout(WAIT_S), bus.Node("first", arguments=[], domain=7) as node:
        assert (tmp_path / "busd" / "7.sock").is_socket()
        assert (tmp_path / "busd").stat().st_mode & 0o777 == 0o700
        await node.create_publisher(Int32, "t")
    wait_until(lambda: not daemons(tmp_path / "busd" / "7.sock"))


def test_where_it_cannot_start(path: Path) -> None:
    """The error has the reason from the daemon's log."""
    path.write_text("precious")
    with pytest.raises(bus.BrokerUnavailable, match="exists and is not a socket"):
        asyncio.run(bus.Node("alone", arguments=[]).open())
    assert path.read_text() == "precious"


async def test_in_place_of_one_that_was_killed(path: Path) -> None:
    async with asyncio.timeout(WAIT_S), bus.Node("first", arguments=[]) as node:
        os.kill((await node.graph()).broker_pid, signal.SIGKILL)
        while True:
            with suppress(bus.BusError):
                async with bus.Node("second", arguments=[], socket=path) as second:
                    if {one.name for one in (await second.graph()).nodes} == {"first", "second"}:
                        break


async def test_given_up_while_it_starts(path: Path) -> None:
    """The daemon still starts, gets no client, and exits."""
    opening = asyncio.ensure_future(bus.Node("impatient", arguments=[]).open())
    await until(lambda: daemons(path))
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    await until(lambda: not daemons(path))
