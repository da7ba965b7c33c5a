"""Fixtures of tests that misuse a daemon and check its other clients, or run examples of pages."""

import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

import cli
from conftest import Daemon
from forks import Forks
from neighbours import Neighbours, resident_bytes
from pages import ROOT, Program, Start
from raw_peer import RawPeer
from users import Guests

MOST_GROWTH_BYTES = 96 << 20
"""Most bytes by which misuse may make busd grow, if the test sets no higher limits."""


@pytest.fixture(scope="session", autouse=True)
def programs_are_forks() -> Iterator[None]:
    with Forks(cli.IMPORTED) as cli.forks:
        yield
    cli.forks = None


@pytest.fixture
def settings() -> str:
    """The text of busd.toml; tests set it by parametrization."""
    return ""


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon], tmp_path: Path, settings: str) -> Daemon:
    if not settings:
        return start_daemon()
    config = tmp_path / "busd.toml"
    config.write_text(settings)
    return start_daemon("--config", str(config))


@pytest.fixture
def neighbours(daemon: Daemon) -> Iterator[Neighbours]:
    """Clients that talk during the test and must receive every message; busd must not grow."""
    with Neighbours(daemon.path) as neighbours:
        neighbours.carry_on()
        before = resident_bytes(daemon.pid)
        yield neighbours
        neighbours.carry_on()
        grown = resident_bytes(daemon.pid) - before
        assert grown < MOST_GROWTH_BYTES, f"busd has grown by {grown >> 20} MiB"


@pytest.fixture
def peer(daemon: Daemon) -> Iterator[RawPeer]:
    """A client that has connected and sent nothing yet."""
    with RawPeer(daemon.path) as peer:
        yield peer


@pytest.fixture
def other(daemon: Daemon) -> Iterator[RawPeer]:
    """A well-behaved client, which the misbehaving one may disturb."""
    with RawPeer(daemon.path) as other:
        yield other.hello()


@pytest.fixture
def guests() -> Iterator[Callable[..., Guests]]:
    """Starts a busd of OWNER with the given rules."""
    with ExitStack() as running:
        yield lambda *rules, **more: running.enter_context(Guests("".join(rules), **more))


@pytest.fixture
def start(socket_path: Path) -> Iterator[Start]:
    """Starts commands; at the end, interrupts the commands that still run."""
    programs: list[Program] = []

    def start(command: str, folder: Path = ROOT) -> Program:
        programs.append(Program(command, folder))
        return programs[-1]

    yield start
    for program in reversed(programs):
        if program.process.poll() is None:
            program.end(signal.SIGINT)
        program.patience.cancel()
        program.output.close()
