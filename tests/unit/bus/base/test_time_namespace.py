"""bus.base.time_namespace: reading the kernel's text, and texts that are invalid."""

import subprocess
import sys
from pathlib import Path

import pytest

from bus.base.time_namespace import monotonic_offset_ns
from rows import for_each


@for_each(
    ("text", "offset_ns"),
    [
        ("monotonic           0         0\nboottime            0         0\n", 0),
        ("monotonic         400         5\nboottime            0         0\n", 400_000_000_005),
        ("monotonic        -400         0\n", -400_000_000_000),
        ("", 0),
        ("monotonic many\n", 0),
        ("monotonic x y\n", 0),
    ],
)
def test_what_the_kernel_says(text: str, offset_ns: int, tmp_path: Path) -> None:
    (tmp_path / "offsets").write_text(text)
    assert monotonic_offset_ns(tmp_path / "offsets") == offset_ns


def test_without_time_namespaces(tmp_path: Path) -> None:
    assert monotonic_offset_ns(tmp_path / "not there") == 0


def test_in_a_time_namespace() -> None:
    enter = ["unshare", "--time", "--monotonic", "1000", "--fork"]
    try:
        may = subprocess.run([*enter, "true"], check=False, capture_output=True).returncode == 0
    except FileNotFoundError:
        may = False
    if not may:
        pytest.skip("unshare --time is not allowed here")
    script = "from bus.base.time_namespace import monotonic_offset_ns; print(monotonic_offset_ns())"
    found = subprocess.run([*enter, sys.executable, "-c", script], check=True, capture_output=True, text=True)
    assert int(found.stdout) == 1000 * 10**9
