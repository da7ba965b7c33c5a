"""bus.link.autostart: traces of a busd in the background in the process that started it."""

import asyncio
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from bus.errors import BrokerUnavailable
from bus.link import autostart, reach
from bus.link.reach import Patience
from bus.wire.messages import Hello
from conftest import WAIT_S, Daemon
from effort import examples
from raw_peer import HELLO, RawPeer
from semantics import until

IDLE = ("--idle-exit", "60")


@pytest.fixture
def path(socket_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.delenv("BUSD_AUTOSTART")
    monkeypatch.setattr(autostart, "_started", set())
    yield socket_path
    for pid in autostart._started:
        os.kill(pid, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(pid, 0)


def is_zombie(pid: int) -> bool:
    """True once all threads have ended: the state in /proc is "zombie" as soon as the first one has ended."""
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def is_there(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


async def started(path: Path) -> int:
    async with asyncio.timeout(WAIT_S):
        await autostart.start(path, IDLE)
    (pid,) = autostart._started
    return pid


@pytest.mark.parametrize(
    "turns", [0, pytest.param(1, marks=pytest.mark.nightly), 2, pytest.param(5, marks=pytest.mark.nightly)]
)
async def test_cancelled_while_it_starts(path: Path, turns: int) -> None:
    """No closed descriptor stays registered for reading: uvloop aborts the process for that."""
    for _ in range(examples(3)):
        starting = asyncio.ensure_future(autostart.start(path, IDLE))
        for _ in range(turns + 1):
            await asyncio.sleep(0)
        if not starting.done():  # on a slow machine the start may have finished already
            starting.cancel()
            with pytest.raises(asyncio.CancelledError):
                await starting
    assert await started_again(path)


async def started_again(path: Path) -> bool:
    async with asyncio.timeout(WAIT_S):
        (await reach.open_socket(path, Patience())).close()
    return bool(autostart._started)


async def test_no_zombies(path: Path) -> None:
    first = await started(path)
    os.kill(first, signal.SIGTERM)
    await until(lambda: is_zombie(first))
    second = await started(path)
    assert second != first
    assert not is_there(first)
    os.kill(second, signal.SIGTERM)
    await until(lambda: is_zombie(second))
    autostart.reap()
    assert not is_there(second)
    assert not autostart._started


async def test_who_comes_second_leaves_the_log_alone(path: Path) -> None:
    await started(path)
    log = path.with_suffix(".log")
    with log.open("a") as file:
        file.write("precious\n")
    async with asyncio.timeout(WAIT_S):
        await autostart.start(path, IDLE)
    _, before, after = log.read_text().splitlines()
    assert before == "precious"
    assert "busd is already running" in after


async def test_not_where_the_caller_forbids_it(path: Path) -> None:
    with pytest.raises(BrokerUnavailable) as caught:
        await reach.open_socket(path, Patience(), may_start=False)
    assert str(caught.value) == f"no busd listens on {path}"
    assert not autostart._started


async def test_a_start_without_a_socket_gives_its_reason(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time limit for an answer begins after the start of busd."""
    now_s = 0.0
    patience = Patience(0.05, lambda: now_s)

    async def nothing(path: Path) -> None:
        nonlocal now_s
        now_s += 1

    async def sleep(seconds: float) -> None:
        nonlocal now_s
        now_s += seconds

    monkeypatch.setattr(autostart, "start", nothing)
    monkeypatch.setattr(asyncio, "sleep", sleep)
    with pytest.raises(BrokerUnavailable, match=r"does not answer: nothing listens there; tried for 0\.05 s"):
        await reach.open_socket(path, patience)
    assert now_s == pytest.approx(1.05)


async def test_a_stranger_s_socket_is_named_as_it_is(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    await started(path)

    def refuse(*_: object) -> None:
        raise BrokerUnavailable("served by a stranger")

    monkeypatch.setattr(reach, "check_server", refuse)
    with pytest.raises(BrokerUnavailable) as caught:
        await reach.open_socket(path, Patience())
    assert str(caught.value) == "served by a stranger"


@pytest.mark.parametrize(("arguments", "background"), [((), False), (IDLE, True)])
def test_it_says_so_in_its_hello(
    start_daemon: Callable[..., Daemon], arguments: tuple[str, ...], background: bool
) -> None:
    daemon = start_daemon(*arguments)
    with RawPeer(daemon.path) as peer:
        peer.write(HELLO)
        assert peer.expect(Hello).background is background
