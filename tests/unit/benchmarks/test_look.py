"""benchmarks/look.py: one measurement."""

import pytest

from benchmarks import look

pytest.importorskip("textual", reason="bus top's screen is textual's")

pytestmark = pytest.mark.landing


def test_looks_and_the_start_are_measured() -> None:
    found = look.measure_looks(10, 1)
    assert 0 < found["asked_ms"] < found["ms"]
    assert look.measure_start()["ms"] > 0
