"""benchmarks/floors: the program in C does its work and reports errors in its arguments."""

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks import paced, throughput
from benchmarks.copying import measure_copying
from benchmarks.machine import ROOT
from benchmarks.systems import C_FLOOR, C_SOCKET, System
from benchmarks.work import Work

pytestmark = [pytest.mark.landing, pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not there")]

FLOORS = [pytest.param(C_FLOOR, id="shm"), pytest.param(C_SOCKET, id="socket")]


@pytest.fixture(scope="module", autouse=True)
def program() -> Path:
    folder = ROOT / "benchmarks" / "floors"
    subprocess.run(["make", "-C", folder], check=True, capture_output=True)
    return folder / "build" / "floor"


@pytest.mark.parametrize("system", FLOORS)
def test_paced(system: System) -> None:
    found = paced.measure(system, Work(size=64, count=50, warm_up=10, rate=1000))

    assert 0 < found["p50"] <= found["max"]
    assert found["due_p50"] >= found["p50"]


@pytest.mark.parametrize("system", FLOORS)
@pytest.mark.parametrize("size", [64, 4 << 20])
def test_flood(system: System, size: int) -> None:
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
    ],
    ids=lambda mistake: mistake.complaint,
)
def test_mistakes(program: Path, mistake: Mistake) -> None:
    ended = subprocess.run([program, *mistake.words], capture_output=True, text=True, check=False)

    assert ended.returncode == 2
    assert mistake.complaint in ended.stderr
