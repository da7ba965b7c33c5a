"""A pytest plugin: each test gets a separate bus, and fails if it leaves nodes on it.

    # conftest.py
    pytest_plugins = ["bus.testing"]

    def test_greeting(bus_node):
        greetings = bus_node.create_subscription(String, "greetings")
        subprocess.run([sys.executable, "greeter.py"], check=True)
        assert greetings.receive(timeout=5)[0].data == "hello"

It is no entry point, so test runs without a bus don't import it and don't show its fixtures. Must know the
daemon only as a program to start.
"""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Generator, Iterator
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec
import pytest

from bus.blocking import BlockingNode, connect
from bus.errors import BrokerUnavailable, BusError
from bus.graph import Graph, GraphEndpoint, GraphNode
from bus.link.autostart import BUSD
from bus.names import service_of_topic

__all__ = ["Domain", "bus_domain", "bus_node"]

_START_S: Final = 10.0
_STOP_S: Final = 10.0
_LOOK_S: Final = 0.1
_LEAVE_S: Final = 1.0
"""Time for a node to leave after its test."""

_IDLE_EXIT_S: Final = 600
"""Time after which an unused busd ends by itself, in case pytest was killed."""

_OBSERVER: Final = "bus_testing"
_OF_EVERY_NODE: Final = {"/rosout", "/parameter_events"}
_LAST_LINES: Final = 50
_HAS_FAILED: Final = pytest.StashKey[bool]()


class Domain:
    """A separate bus during `with Domain() as domain:`, with a busd on a socket in a temporary folder.

    Meanwhile that socket is the default in this process and its children (`BUSD_SOCKET`), and none of them
    starts another busd (`BUSD_AUTOSTART=0`). The fixture `bus_domain` is one. For a bus that lasts longer
    than a test, make a fixture with that name and another scope. `options` are options of busd, such as
    `--config FILE`.
    """

    def __init__(self, *options: str) -> None:
        self._options = options
        self._folder = Path(tempfile.mkdtemp(prefix="bus-"))  # short: a socket's path has 107 bytes at most
        self.socket = self._folder / "busd.sock"
        """The socket on which busd listens."""
        self._log = self._folder / "busd.log"
        self._process: subprocess.Popen[bytes] | None = None
        self._environ = pytest.MonkeyPatch()

    @property
    def pid(self) -> int:
        """The process id of busd; 0 while busd does not run."""
        return 0 if self._process is None else self._process.pid

    @property
    def log(self) -> str:
        """busd's output."""
        return self._log.read_text(errors="replace") if self._log.exists() else ""

    def start(self) -> None:
        """Start busd, again after `stop` or `kill`; returns when it is ready.

        Raises BrokerUnavailable with its last line if it ends or hangs.
        """
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ready, self._log.open("ab") as log:
            ready.bind("")  # an abstract address that the kernel chooses
            ready.settimeout(_LOOK_S)
            environ = {**os.environ, "NOTIFY_SOCKET": "@" + ready.getsockname()[1:].decode()}
            self._process = subprocess.Popen(
                [*BUSD, "--socket", str(self.socket), "--idle-exit", str(_IDLE_EXIT_S), *self._options],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                env=environ,
                start_new_session=True,  # Ctrl-C ends pytest, and that ends busd
            )
            end_s = time.monotonic() + _START_S
            while self._process.poll() is None and time.monotonic() < end_s:
                with contextlib.suppress(TimeoutError):
                    ready.recv(4096)
                    return
        self.kill()
        why = (self.log.strip().splitlines() or ["it said nothing"])[-1]
        raise BrokerUnavailable(f"busd could not be started for a test: {why}")

    def stop(self) -> None:
        """End busd in order. Nodes that are still open wait until it is back."""
        self._end(signal.SIGTERM)

    def kill(self) -> None:
        """Kill busd by SIGKILL, which programs must survive."""
        self._end(signal.SIGKILL)

    def graph(self) -> Graph:
        """All nodes, endpoints and matches now, without the node that requests them."""
        return _ask(None)

    def leaked(self) -> list[str]:
        """A line for each node that does not leave within a second; none if busd does not run."""
        try:
            graph = _ask(_LEAVE_S)
        except BrokerUnavailable:
            return []
        return [_describe(node, graph) for node in graph.nodes]

    def __enter__(self) -> Self:
        self._environ.setenv("BUSD_SOCKET", str(self.socket))
        self._environ.setenv("BUSD_AUTOSTART", "0")
        try:
            self.start()
        except BaseException:
            self._clean_up()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.stop()
        finally:
            self._clean_up()

    def _end(self, number: signal.Signals) -> None:
        process, self._process = self._process, None
        if process is None or process.poll() is not None:
            return
        process.send_signal(signal.SIGCONT)  # a test may have stopped it
        process.send_signal(number)
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise

    def _clean_up(self) -> None:
        self._environ.undo()
        shutil.rmtree(self._folder, ignore_errors=True)


@pytest.fixture
def bus_domain(request: pytest.FixtureRequest) -> Iterator[Domain]:
    """A separate bus for this test, which programs find by the environment.

    A test that passes and leaves nodes on it is an error that names them. If a test fails, the report has
    busd's output.
    """
    with Domain() as domain:
        yield domain
        if not request.node.stash.get(_HAS_FAILED, False) and (leaked := domain.leaked()):
            lines = "".join(f"\n  {line}" for line in leaked)
            pytest.fail(
                f"nodes were left on the bus:{lines}\n"
                "close them (`with`, `async with`, `close()`), and end the programs that the test started",
                pytrace=False,
            )


@pytest.fixture
def bus_node(bus_domain: Domain) -> Iterator[BlockingNode]:
    """A node named `test` on the test's bus, made by `bus.connect`.

    Tests that are `async def` can't use it; use `async with bus.Node("test") as node` there.
    """
    with connect("test", arguments=[]) as node:
        yield node


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Note that a test has failed, and add busd's output to the report."""
    report = yield
    if report.failed:
        item.stash[_HAS_FAILED] = True
        domain = getattr(item, "funcargs", {}).get("bus_domain")
        if isinstance(domain, Domain) and (log := domain.log):
            report.sections.append(("busd", "\n".join(log.splitlines()[-_LAST_LINES:])))
    return report


def _ask(empty_within_s: float | None) -> Graph:
    """The graph without the requesting node. With a time, wait up to that for a graph without any other node.

    It uses a thread, because an event loop may run in this one.
    """
    found: list[Graph | BusError] = []

    def ask() -> None:
        try:
            with connect(_OBSERVER, arguments=[], rosout=False) as observer:
                if empty_within_s is not None:
                    with contextlib.suppress(TimeoutError):
                        observer.wait_for_graph(lambda graph: not _others(graph).nodes, empty_within_s)
                found.append(_others(observer.graph()))
        except BusError as error:
            found.append(error)

    thread = threading.Thread(target=ask, name="bus testing")
    thread.start()
    thread.join()
    if isinstance(found[0], BusError):
        raise found[0]
    return found[0]


def _others(graph: Graph) -> Graph:
    nodes = tuple(one for one in graph.nodes if (one.name, one.pid) != (_OBSERVER, os.getpid()))
    return msgspec.structs.replace(graph, nodes=nodes)


def _describe(node: GraphNode, graph: Graph) -> str:
    """A text that identifies a node: its name, its process, its topics and services."""
    served = {
        service for service in graph.services() for one in graph.servers_of(service) if one.node == node
    }
    uses = [
        *(f"publishes {one}" for one in _topics(node, graph.publishers)),
        *(f"subscribes to {one}" for one in _topics(node, graph.subscriptions)),
        *(f"serves {one}" for one in sorted(served) if not one.startswith(f"{node.full_name}/")),
    ]
    where = "this process" if node.pid == os.getpid() else f"process {node.pid}{_command(node.pid)}"
    return f"{node.full_name} of {where}" + (f": {', '.join(uses)}" if uses else "")


def _topics(node: GraphNode, endpoints: tuple[GraphEndpoint, ...]) -> list[str]:
    topics = {one.topic for one in endpoints if one.node == node} - _OF_EVERY_NODE
    return sorted(one for one in topics if service_of_topic(one) is None)


def _command(pid: int) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return ""
    return f" ({' '.join(words).strip()})"
