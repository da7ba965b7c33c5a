"""Programs in a memory cgroup, as in a container: at its limit they get errors, and the kernel kills none.

Needs a machine that lets the tests make cgroups, of either version;
tests/unit/bus/shm/test_headroom.py does not.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import c_programs
from chaos import cgroup as cgroups
from conftest import WAIT_S, Daemon
from neighbours import wait_until

pytestmark = [pytest.mark.landing, pytest.mark.usefixtures("daemon")]

MiB = 1 << 20
LIMIT_MIB = 120

PROGRAM = """
import asyncio, json, sys
import bus, msgspec

class Frame(msgspec.Struct):
    number: int = 0
    data: bytes = b""

async def main():
    name, count, size, depth, last = sys.argv[1], *map(int, sys.argv[2:])
    async with bus.Node(name, arguments=[]) as node:
        subscription = await node.create_subscription(Frame, name, depth)
        publisher = await node.create_publisher(Frame, name, depth)
        for number in range(count):
            publisher.publish(Frame(number, bytes(size)))
            await asyncio.sleep(0.01)
        error = ""
        if last:
            try:
                publisher.publish(Frame(count, bytes(last)))
            except bus.SharedMemoryError as caught:
                error = str(caught)
        heard = []
        while (taken := subscription.take()) is not None:
            heard.append(taken[0].number)
        print(json.dumps([heard, subscription.statistics().dropped, error]))

bus.run(main())
"""


@pytest.fixture
def cgroup() -> Iterator[Path]:
    """A new cgroup with LIMIT_MIB."""
    if reason := cgroups.why_not():
        pytest.skip(reason)
    place = cgroups.make("test", LIMIT_MIB * MiB)
    yield place
    remove(place)


def remove(place: Path) -> None:
    def is_removed() -> bool:
        with contextlib.suppress(OSError):  # the kernel needs a moment after its last process
            cgroups.remove(place)
        return not place.exists()

    wait_until(is_removed)


def start(cgroup: Path, *arguments: object) -> subprocess.Popen[str]:
    """Runs PROGRAM in the cgroup."""
    enter = f"import os; open({str(cgroup / 'cgroup.procs')!r}, 'w').write(str(os.getpid()))\n"
    words = [sys.executable, "-c", enter + PROGRAM, *map(str, arguments)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def end(program: subprocess.Popen[str]) -> tuple[list[int], dict[str, int], str, str]:
    """The messages that a program received, those that it lost, its error, and its log."""
    output, log = program.communicate(timeout=WAIT_S)
    assert program.returncode != -signal.SIGKILL, f"killed by the kernel: {log}"
    assert not program.returncode, log
    heard, dropped, error = json.loads(output)
    return heard, dropped, error, log


@pytest.mark.parametrize("route", ["shm"], indirect=True)
class TestGrowth:
    def test_depth_suffers_and_a_message_that_does_not_fit_is_an_error(
        self, route: str, cgroup: Path
    ) -> None:
        heard, dropped, error, log = end(start(cgroup, "p", 60, 4 * MiB, 1000, 20 * MiB))
        assert heard == list(range(60 - len(heard), 60))
        assert heard
        assert sum(dropped.values()) == 60 - len(heard)
        where = f"memory cgroup {cgroup} has "
        assert f"the ring of '/p' can't grow to 65536 KiB: {where}" in log
        assert error.startswith("no shared memory for a message of 20971")
        assert where in error
        assert f"of {LIMIT_MIB} MiB left; this takes 137 and a reserve of " in error

    def test_the_limit_of_one_that_it_is_in(self, route: str, cgroup: Path) -> None:
        inner = cgroup / "inner"
        inner.mkdir()
        try:
            heard, _, _, log = end(start(inner, "p", 60, 4 * MiB, 1000, 0))
            assert heard
            assert f"memory cgroup {cgroup} has" in log
        finally:
            remove(inner)

    def test_several_at_a_time(self, route: str, cgroup: Path) -> None:
        """One program may use up the rest of the memory; the kernel kills none."""
        programs = [start(cgroup, f"p{number}", 300, MiB, 300, 0) for number in range(3)]
        for program in programs:
            program.wait(WAIT_S)
        for program in programs:
            heard, _, _, _ = end(program)
            assert heard == list(range(300 - len(heard), 300))


@pytest.mark.parametrize("route", ["socket"], indirect=True)
def test_queues_by_socket_take_no_more_than_there_is(route: str, cgroup: Path) -> None:
    """There is no reader: of 240 MiB, the process can keep a part."""
    _, _, error, log = end(start(cgroup, "p", 80, 4 * MiB, 1000, 0))
    assert error == log == ""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can take a mount away")
@pytest.mark.parametrize("route", ["shm"], indirect=True)
@pytest.mark.parametrize("change", ["mount -t tmpfs -o size=4k none /dev/shm", "mount -t tmpfs none /dev"])
def test_no_folder_of_shared_memory_is_needed(route: str, daemon: Daemon, change: str) -> None:
    """Containers have a small /dev/shm or none, and rings do not need it."""
    words = ["unshare", "-m", "sh", "-c", f'{change} && exec "$@"', "-", sys.executable, "-c", PROGRAM]
    arguments = ["p", "60", str(MiB), "60", "0"]
    try:
        done = subprocess.run(
            [*words, *arguments], capture_output=True, text=True, timeout=WAIT_S, check=False
        )
    except FileNotFoundError:
        pytest.skip("needs unshare")
    if "Operation not permitted" in done.stderr:
        pytest.skip("may make no namespace of mounts")
    assert not done.returncode, done.stderr
    assert json.loads(done.stdout) == [list(range(60)), {}, ""]
    assert done.stderr == ""


@pytest.mark.parametrize("route", ["shm"], indirect=True)
def test_a_publisher_in_c(route: str, cgroup: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Each ring takes 32 MiB. The kernel kills nothing; the first ring without memory is an error."""
    program = c_programs.build_once(tmp_path_factory) / "callbacks"
    enter = f"import os, sys; open({str(cgroup / 'cgroup.procs')!r}, 'w').write(str(os.getpid())); "
    words = [sys.executable, "-c", enter + "os.execv(sys.argv[1], sys.argv[1:])", str(program), "grow"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert done.returncode == 0, done.stderr
    *made, refused, _ = done.stdout.splitlines()
    assert made == [f"ring {number}" for number in range(len(made))]
    assert 1 <= len(made) <= 3
    assert refused == f"-12: /t{len(made)}: no memory for a ring for a message of 4194304 bytes"
