"""benchmarks/web.py: one measurement, as short as possible."""

import pytest

from benchmarks import web

pytest.importorskip("websockets", reason="bus web's server is made of websockets")

pytestmark = pytest.mark.nightly


def test_what_nobody_looks_at_costs_nothing() -> None:
    found = web.measure_idle(0.5)
    assert found["subscriptions"] == 0


def test_a_page_at_the_robot_and_a_viewer_that_hangs() -> None:
    found = web.measure_robot(1.0)
    assert found["us_per_s"] > 0
    assert found["hz"] > 0
    ages = web.measure_imu(100)
    assert ages["p50_us"] > ages["own_p50_us"] > 0
    assert web.measure_stopped(1.0)["mib"] > 0
