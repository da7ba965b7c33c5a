"""benchmarks/c: the programs in C do their work and report errors in their arguments."""

import fcntl
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import gettempdir

import pytest

from benchmarks import c_client, paced, throughput
from benchmarks.copying import measure_copying
from benchmarks.harness import Failure
from benchmarks.machine import ROOT
from benchmarks.plan import Plan
from benchmarks.servers import serve_roudi
from benchmarks.systems import C_FLOOR, System
from benchmarks.work import Work

pytestmark = [pytest.mark.landing, pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not there")]

SYSTEMS = [pytest.param(one, id=one.name) for one in c_client.SYSTEMS]


@pytest.fixture(scope="module", autouse=True)
def program() -> Path:
    folder = ROOT / "benchmarks" / "c"
    bus = Path(sys.executable).with_name("bus")
    # One worker at a time: a program that another one is still linking can't be started.
    with (folder / "Makefile").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        subprocess.run(["make", "-C", folder, f"BUS={bus}"], check=True, capture_output=True)
    return folder / "build" / "bare"


@pytest.fixture(autouse=True)
def turn(request: pytest.FixtureRequest) -> Iterator[None]:
    """A machine has at most one daemon of iceoryx, and the tests run side by side."""
    callspec = getattr(request.node, "callspec", None)
    system = callspec and callspec.params.get("system")
    if system is None or system.serve is not serve_roudi:
        yield
        return
    with Path(gettempdir(), "bus-benchmarks-roudi.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def need(system: System) -> None:
    if missing := system.missing():
        pytest.skip(f"{system.name}: {missing}")


@pytest.mark.parametrize("system", SYSTEMS)
def test_paced(system: System) -> None:
    need(system)
    found = paced.measure(system, Work(size=64, count=50, warm_up=10, rate=1000))

    assert 0 < found["p50"] <= found["max"]
    assert found["due_p50"] >= found["p50"]


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("size", [64, 4 << 20])
def test_flood(system: System, size: int) -> None:
    need(system)
    found = throughput.measure(system, Work(size=size, count=200, warm_up=20))

    assert found["bytes_per_s"] == pytest.approx(found["per_s"] * size)


def test_copying() -> None:
    found = measure_copying(1 << 20, 20)

    assert found["bytes_per_s"] == pytest.approx(found["per_s"] * (1 << 20))


@dataclass
class Mistake:
    words: list[str]
    complaint: str


@pytest.mark.parametrize(
    "mistake",
    [
        Mistake(["publisher"], "2 words and not 8"),
        Mistake(["publisher", "shm", ".", "8", "1", "1", "0"], "a size of 8 B: at least 16"),
        Mistake(["publisher", "pigeon", ".", "64", "1", "1", "0"], "this program has no way pigeon"),
    ],
    ids=lambda mistake: mistake.complaint,
)
def test_mistakes(program: Path, mistake: Mistake) -> None:
    ended = subprocess.run([program, *mistake.words], capture_output=True, text=True, check=False)

    assert ended.returncode == 2
    assert mistake.complaint in ended.stderr


def test_a_match_by_the_wrong_route_is_no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise a machine without memfd would publish figures of the socket as those of the ring."""
    need(c_client.RING)
    system = c_client.RING._replace(environ={**c_client.RING.environ, "BUS_ROUTE": "socket"})
    with pytest.raises(Failure, match="the match is not by: ring"):
        paced.measure(system, Work(size=64, count=5, warm_up=1, rate=1000))


def test_the_section(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each size has every system, and the bars compare like with like."""
    figures = dict.fromkeys(("p50", "p90", "p99", "cpu", "per_s", "bytes_per_s", "seconds"), 2.0)
    monkeypatch.setattr(System, "missing", str)
    for module in (paced, throughput):
        monkeypatch.setattr(module, "measure", lambda *_, **__: figures)
    found = c_client.run(Plan(quick=False, repetitions=1))
    names = [row.name for row in found.rows]
    assert len(set(names)) == len(names)
    for size in ("64 B", "64 KiB", "1 MiB"):
        assert {f"{size}, {one.name}" for one in c_client.SYSTEMS} <= {*names}
        assert {f"{size}, flood, {one.name}" for one in c_client.SYSTEMS} <= {*names}
    bars = {one.name: one for one in found.comparisons}
    assert bars[f"64 B, {c_client.RING.name} / {C_FLOOR.name}, p50"].at_most == 1.3
    lent = f"1 MiB, {c_client.VIEWED.name} / {c_client.ICEORYX_VIEWED.name}, p50"
    assert bars[lent].at_most == 1.0
