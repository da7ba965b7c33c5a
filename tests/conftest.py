"""Fixtures of all tests: a separate daemon for each test, and checks for resources left open."""

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
from effort import DAILY, NIGHTLY
from forks import Fork, Forks

# If a test is slow, the cause is the machine. Nightly runs have more examples, different ones each time.
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

# Debug mode is for the tests themselves; programs that they start run as for users.
_WITH_DEBUG = bool(os.environ.pop("PYTHONASYNCIODEBUG", ""))

_FACTOR = float(os.environ.get("BUSD_TESTS_TIMEOUT_FACTOR", "1"))

WAIT_S = 60.0 * _FACTOR
"""The longest wait of a test. With a load of 20 on two processors, programs took 20 s to start."""

SOON_S = 5.0 * _FACTOR
"""Limit for an event that otherwise only a lease of 10 s or more would cause."""

CLOSE_S = 2.0 * _FACTOR
"""For code that closes descriptors in separate threads."""
TEST_S = 2 * WAIT_S
"""The longest time of an async test: a test that hangs fails, and shows where."""


class Daemon:
    """A busd process on its own socket: a fork, or without `forks` a new Python."""

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
                process = self.forks.run(words, stderr=log.fileno())
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
    """Restore signals in each process that runs tests, before its first program."""
    inherited_signals.restore()


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """Restore blocked signals and handlers after each test.

    Programs of later tests would inherit blocked signals. With another handler, a later test could end this
    process.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    after = signal.pthread_sigmask(signal.SIG_SETMASK, before)
    assert after == before
    assert {number: signal.signal(number, handler) for number, handler in handlers.items()} == handlers


@pytest.fixture(autouse=True)
def no_descriptors_left() -> Iterator[None]:
    """Check that each test closes its descriptors."""
    before = open_descriptors().items()
    yield
    left = dict(open_descriptors().items() - before)
    # The collector does not see some objects (gc=False), so descriptors that they hold are closed later.
    # zenoh closes its sockets in its own threads, some time after the end of its session.
    end = time.monotonic() + CLOSE_S
    while left and (gc.collect() or time.monotonic() < end):
        time.sleep(0.001)
        left = dict(open_descriptors().items() - before)
    assert not left, f"descriptors left open: {left}"


def open_descriptors() -> dict[str, str]:
    found = {}
    # It runs before and after each test, and by pathlib it takes three times as long.
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208
        try:
            target = os.readlink(f"/proc/self/fd/{name}")  # noqa: PTH115
        except OSError:
            continue
        if target.startswith(("socket:", "anon_inode:", "/memfd")) or "busd" in target:
            found[name] = target
    return found


def pytest_asyncio_loop_factories(config: pytest.Config, item: pytest.Item) -> object:
    """Run every async test on both event loops."""
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
    parser.addoption("--landing", action="store_true", help="the tests marked landing too")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--nightly"):
        hypothesis.settings.load_profile("nightly")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if isinstance(item, pytest.Function) and asyncio.iscoroutinefunction(item.obj):
            item.obj = bounded(item.obj)
    if not config.getoption("--nightly"):
        lands = config.getoption("--landing")
        chosen = [item for item in items if _is_chosen(item, lands=lands)]
        config.hook.pytest_deselected(items=list({*items} - {*chosen}))
        items[:] = chosen


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep collected tests out of later garbage collections, each of which took 0.2 s.

    Their garbage, some 20 MB, stays, too: a single collection of all of this takes half a second.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.fixture(scope="module", autouse=True)
def frozen() -> None:
    """The same for imports of an earlier module; bus.run, called by its tests, has unfrozen everything."""
    gc.collect()
    gc.freeze()


def _is_chosen(item: pytest.Item, *, lands: bool) -> bool:
    """Whether a run without --nightly has the test; `lands`: it has the tests marked landing too."""
    if item.get_closest_marker("nightly") is not None:
        return False
    return (lands or item.get_closest_marker("landing") is None) and _is_in_half(item)


def _is_in_half(item: pytest.Item) -> bool:
    """Whether a combination of loop and route belongs to the test's half.

    A test runs with two of the four combinations, which include each loop and each route. Its name selects
    the two: all tests together use all four. The same holds for loop and distribution of ROS 2. A test
    without route and distribution runs on one loop, unless it is marked `both_loops`.
    """
    ids = item.callspec.id.split("-") if hasattr(item, "callspec") else []
    if not ("asyncio" in ids) ^ ("uvloop" in ids):
        return True
    for one, other in (("shm", "socket"), ("jazzy", "kilted")):
        if (one in ids) ^ (other in ids):
            break
    else:
        if item.get_closest_marker("both_loops") is not None:
            return True
        one = ""
    name = item.nodeid.partition("[")[0]
    return ("asyncio" in ids) ^ (one in ids) ^ bool(crc32(name.encode()) & 1)


def bounded(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., Coroutine[Any, Any, None]]:
    @wraps(test)
    async def run(*args: Any, **kwargs: Any) -> None:
        async with asyncio.timeout(TEST_S):
            await test(*args, **kwargs)

    return run
