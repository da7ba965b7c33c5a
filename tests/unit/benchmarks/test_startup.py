"""benchmarks/: starts, first messages, idle systems and the memory of endpoints: one measurement of each."""

import gc
import mmap
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import idle, memory, startup
from benchmarks.adapters import talkers
from benchmarks.adapters.holding import usage_of
from benchmarks.cases import Outcome
from benchmarks.harness import Failure
from benchmarks.systems import BUS, BUS_SOCKET, PYZMQ, RIVALS, System
from benchmarks.work import TOPIC

pytestmark = pytest.mark.landing


def _or_skip(system: System) -> System:
    reason = system.missing()
    if reason:
        pytest.skip(reason)
    return system


# --- starts


def test_starts_are_measured(tmp_path: Path) -> None:
    assert startup.measure_first_by_rclpy()["ms"] > 0
    assert startup.measure_with_autostart()["ms"] > 0
    assert startup.measure_program([sys.executable, "-m", "bus_cli", "topic", "list"], on_bus=True)["ms"] > 0
    echo = [sys.executable, "-m", "bus_cli", "topic", "echo", "--once", f"/{TOPIC}"]
    assert startup.measure_beside_talker(echo)["ms"] > 0
    script = "import sys; sys.exit('rclpy' not in dir())"
    run = [sys.executable, "-m", "bus_cli", "run"]
    assert startup.measure_program(run, script=f"import rclpy; {script}")["ms"] > 0
    with pytest.raises(Failure, match="exited with 1"):
        startup.measure_program(run, script=script)
    startup.end_busd(tmp_path / "of_nobody.sock")


@pytest.mark.parametrize(
    ("system", "talker"),
    [
        (BUS, ""),
        (BUS_SOCKET, ""),
        *((system, "") for system in RIVALS if system.fans_out),
        (PYZMQ, "zeromq_asyncio"),
    ],
    ids=lambda value: value if isinstance(value, str) else value.name,
)
def test_the_first_message_of_each_system(system: System, talker: str) -> None:
    assert startup.measure_first_message(_or_skip(system), talker)["ms"] > 0


@pytest.mark.parametrize("system", [BUS, BUS_SOCKET, PYZMQ], ids=lambda system: system.name)
def test_the_first_message_of_each_listener(system: System) -> None:
    assert startup.measure_listener(_or_skip(system))["ms"] > 0


def test_a_talker_that_ends_with_an_error_is_a_failure() -> None:
    with pytest.raises(Failure, match="KeyError: 'nobody'"):
        startup.measure_first_message(BUS_SOCKET, "nobody")


def _loaded_by(module: str) -> set[str]:
    """The modules that a fresh Python has loaded after it imported `module`."""
    paths = f"import sys; sys.path[:0] = {sys.path!r}"
    command = [sys.executable, "-I", "-c", f"{paths}; import {module}; print(*sys.modules)"]
    return set(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.split())


@pytest.mark.parametrize(
    "module",
    sorted({one.module for one in RIVALS if one.runner == PYZMQ.runner and not one.missing()}),
)
def test_the_processes_of_rivals_load_nothing_of_ours(module: str) -> None:
    """Their start and memory are measured, so they load neither the bus nor its command line."""
    loaded = _loaded_by(module)

    assert module in loaded
    assert not {"bus", "bus_cli", "busd"} & loaded


def test_talkers_pay_for_nothing_that_they_do_not_need() -> None:
    loaded = _loaded_by("benchmarks.adapters.talkers")

    assert "benchmarks.adapters.talkers" in loaded
    assert not {"asyncio", "msgspec", "uvloop", "bus", "benchmarks.work", "bus_cli"} & loaded
    assert (TOPIC, startup.FIRST.size) == (talkers.TOPIC, talkers.SIZE)


def test_every_rival_that_fans_out_has_a_talker() -> None:
    names = {system.module.rpartition(".")[2] for system in RIVALS if system.fans_out}

    assert names <= set(talkers.TALKERS)


# --- idle systems

BROKEN = """
import sys
print('{"event": "ready"}', flush=True)
sys.exit(3)
"""


def test_idle_systems_are_watched_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "broken_system.py").write_text(BROKEN)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    broken = System("broken", "broken_system")
    missing = Outcome("missing", missing="it is not here")
    names = (idle.MANY, BUS_SOCKET.name, broken.name)
    outcomes = {name: Outcome(name) for name in names} | {missing.name: missing}

    idle.measure(outcomes, [BUS_SOCKET, broken], 0.1, settle_s=0.0)

    assert outcomes[idle.MANY].repetitions[0]["processes"] == 6
    (pair,) = outcomes[BUS_SOCKET.name].repetitions
    assert pair["processes"] == 3
    assert pair["us_per_s"] >= pair["server_us_per_s"] >= 0
    assert "exited with 3" in outcomes[broken.name].failure
    assert not outcomes[broken.name].repetitions
    assert not missing.repetitions


# --- memory


def test_memory_of_endpoints(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_NUMBER", 20)

    by_ring, by_socket = memory.measure(_or_skip(BUS)), memory.measure(BUS_SOCKET)

    assert by_ring["publisher: shared"] > 0
    assert by_socket["publisher: shared"] == 0


def test_usage_tells_shared_memory_from_private_and_counts_a_segment_once() -> None:
    gc.collect()  # free the objects of earlier tests now, not between the two measurements
    before = usage_of(os.getpid())
    size = 1 << 20
    with os.fdopen(os.memfd_create("busd-test-of-usage"), "r+b") as file:
        file.truncate(size)
        with mmap.mmap(file.fileno(), size) as once, mmap.mmap(file.fileno(), size) as again:
            once[:] = again[:]
            shared = usage_of(os.getpid())
            with mmap.mmap(-1, 8 * size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS) as private:
                for offset in range(0, len(private), mmap.PAGESIZE):
                    private[offset] = 1
                both = usage_of(os.getpid())

    assert shared.shared - before.shared == 1024
    assert shared.private - before.private < 8 * 1024
    assert both.private - shared.private >= 7 * 1024
