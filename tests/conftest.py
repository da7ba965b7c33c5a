"""Fixtures of all tests: a daemon of its own for each test, and a look at what is left behind."""

import asyncio
import gc
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Generator, Iterator
from functools import partial, wraps
from pathlib import Path
from typing import Any
from zlib import crc32

import hypothesis
import pytest

import inherited_signals
from bus import shm
from effort import DAILY, NIGHTLY, is_nightly
from forks import Fork, Forks

# What is slow here is the machine. By night there are more examples, and others each time.
hypothesis.settings.register_profile(
    "daily",
    deadline=None,
    derandomize=True,
    max_examples=DAILY,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.register_profile(
    "nightly",
    hypothesis.settings.get_profile("daily"),
    derandomize=False,
    max_examples=NIGHTLY,
    print_blob=True,
)
hypothesis.settings.load_profile("daily")

# For the tests themselves; what they start shall be as users see it.
_WITH_DEBUG = bool(os.environ.pop("PYTHONASYNCIODEBUG", ""))

_FACTOR = float(os.environ.get("BUSD_TESTS_TIMEOUT_FACTOR", "1"))

WAIT_S = 60.0 * _FACTOR
"""No test waits longer for anything. Beside a load of 20 on two processors, programs took 20 s to start."""

SOON_S = 5.0 * _FACTOR
"""Limit for an event that otherwise a lease of 10 s or more would cause."""

CLOSE_S = 2.0 * _FACTOR
"""For what closes descriptors in threads of its own."""
TEST_S = 2 * WAIT_S
"""No async test takes longer: one that hangs fails, and shows where."""


class Daemon:
    """A busd process on a socket of its own: a fork, or without `forks` a Python that is started."""

    def __init__(self, path: Path, *arguments: str, forks: Forks | None = None) -> None:
        self.path = path
        self.arguments = arguments
        self.forks = forks
        self.log = path.with_suffix(".stderr")
        self.process = self._start()

    def _start(self) -> subprocess.Popen[bytes] | Fork:
        words = ["-m", "busd", "--socket", str(self.path), *self.arguments]
        process: subprocess.Popen[bytes] | Fork
        with self.log.open("ab") as log:
            if self.forks is None or not self.forks.can_run():
                process = subprocess.Popen([sys.executable, *words], stderr=log)
            else:
                process = self.forks.run(words, stderr=log.fileno(), is_finalized=is_nightly())
        self._wait_until_ready(process)
        return process

    def _wait_until_ready(self, process: subprocess.Popen[bytes] | Fork) -> None:
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            with socket.socket(socket.AF_UNIX) as probe:
                try:
                    probe.connect(str(self.path))
                    return
                except OSError:
                    if process.poll() is not None:
                        raise RuntimeError(f"busd ended: {self.log.read_text()}") from None
                    time.sleep(0.005)
        raise TimeoutError("busd did not become ready")

    @property
    def pid(self) -> int:
        return self.process.pid

    def kill(self) -> None:
        """kill -9"""
        self.process.kill()
        self.process.wait(WAIT_S)

    def restart(self) -> None:
        self.process = self._start()

    def stop(self) -> str:
        """End it in order; returns its log."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
        self.process.wait(WAIT_S)
        return self.log.read_text()


@pytest.fixture
def socket_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A path for a daemon's socket, which is the default for this process and its children."""
    path = tmp_path / "busd.sock"
    monkeypatch.setenv("BUSD_SOCKET", str(path))
    monkeypatch.setenv("BUSD_AUTOSTART", "0")
    return path


@pytest.fixture(params=["shm", "socket"])
def route(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The route of all matches that can choose: the semantics are the same by both."""
    monkeypatch.delenv("BUS_ROUTE", raising=False)
    if request.param == "socket":
        monkeypatch.setenv("BUS_ROUTE", "socket")
    elif not shm.is_available():
        pytest.skip(shm.why_not())
    return str(request.param)


@pytest.fixture(scope="session")
def forks() -> Iterator[Forks]:
    with Forks() as forks:
        yield forks


@pytest.fixture
def start_daemon(socket_path: Path, forks: Forks) -> Iterator[Callable[..., Daemon]]:
    """Starts the test's daemon with the given arguments; at the end it must have no traceback in its log."""
    daemons: list[Daemon] = []

    def start(*arguments: str) -> Daemon:
        daemons.append(Daemon(socket_path, *arguments, forks=forks))
        return daemons[-1]

    yield start
    for daemon in daemons:
        log = daemon.stop()
        assert "Traceback" not in log, log
        assert daemon.process.returncode in (0, -signal.SIGKILL), log


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon]) -> Daemon:
    return start_daemon()


@pytest.fixture(scope="session", autouse=True)
def signals_as_in_a_terminal() -> None:
    """In each process that runs tests, before its first program."""
    inherited_signals.restore()


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """What a test blocks, the programs of all later tests would not hear; what it has end a process, a later
    test would end this one by."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    after = signal.pthread_sigmask(signal.SIG_SETMASK, before)
    assert after == before
    assert {number: signal.signal(number, handler) for number, handler in handlers.items()} == handlers


@pytest.fixture(autouse=True)
def no_descriptors_left() -> Iterator[None]:
    """Each test closes what it opens."""
    before = open_descriptors().items()
    yield
    left = dict(open_descriptors().items() - before)
    # What is held by something that the collector does not look at (gc=False) goes a time later than that.
    # And zenoh closes its sockets in threads of its own, some time after its session has closed.
    end = time.monotonic() + CLOSE_S
    while left and (gc.collect() or time.monotonic() < end):
        time.sleep(0.001)
        left = dict(open_descriptors().items() - before)
    assert not left, f"descriptors left open: {left}"


def open_descriptors() -> dict[str, str]:
    found = {}
    for entry in Path("/proc/self/fd").iterdir():
        try:
            what = str(entry.readlink())
        except OSError:
            continue
        if what.startswith(("socket:", "anon_inode:", "/memfd")) or "busd" in what:
            found[entry.name] = what
    return found


def pytest_asyncio_loop_factories(config: pytest.Config, item: pytest.Item) -> object:
    """Every async test runs on both event loops."""
    import uvloop

    def with_debug(factory: Callable[[], asyncio.AbstractEventLoop]) -> asyncio.AbstractEventLoop:
        loop = factory()
        loop.set_debug(_WITH_DEBUG)
        return loop

    return {
        "asyncio": partial(with_debug, asyncio.new_event_loop),
        "uvloop": partial(with_debug, uvloop.new_event_loop),
    }


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--nightly",
        action="store_true",
        help="the tests marked nightly too, each loop with each route and not two of the four, more examples",
    )


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--nightly"):
        hypothesis.settings.load_profile("nightly")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if isinstance(item, pytest.Function) and asyncio.iscoroutinefunction(item.obj):
            item.obj = bounded(item.obj)
    if not config.getoption("--nightly"):
        config.hook.pytest_deselected(items=[item for item in items if not _is_daily(item)])
        items[:] = [item for item in items if _is_daily(item)]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected stays, so that later no collection of garbage looks at it: each of them took 0.2 s.

    So does its garbage, some 20 MB: a collection that looks at all of this once takes half a second.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def frozen() -> None:
    """Nor at what an earlier module has imported; and bus.run, called by its tests, has unfrozen all."""
    gc.collect()
    gc.freeze()


def _is_daily(item: pytest.Item) -> bool:
    return item.get_closest_marker("nightly") is None and _is_in_half(item)


def _is_in_half(item: pytest.Item) -> bool:
    """Of the four combinations of loop and route each test has two, in which each loop and each route is.

    Which two hangs on its name, so that all tests together have all four. So it is with loop and distribution
    of ROS 2. What is marked `either_loop` and has neither has one loop.
    """
    ids = item.callspec.id.split("-") if hasattr(item, "callspec") else []
    if not ("asyncio" in ids) ^ ("uvloop" in ids):
        return True
    for one, other in (("shm", "socket"), ("jazzy", "kilted")):
        if (one in ids) ^ (other in ids):
            break
    else:
        if item.get_closest_marker("either_loop") is None:
            return True
        one = "asyncio or uvloop"
    name = item.nodeid.partition("[")[0]
    return ("asyncio" in ids) ^ (one in ids) ^ bool(crc32(name.encode()) & 1)


def bounded(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., Coroutine[Any, Any, None]]:
    @wraps(test)
    async def run(*args: Any, **kwargs: Any) -> None:
        async with asyncio.timeout(TEST_S):
            await test(*args, **kwargs)

    return run
