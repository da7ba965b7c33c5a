"""Losses of several topics over one time, as text and as a picture."""

from xml.etree import ElementTree

import pytest

from bus_plot.loss_timeline import LossTimeline, Slot
from bus_plot.strips import Strip, strips_svg, strips_text, tick_step

SVG = "{http://www.w3.org/2000/svg}"


def moment(at_s: int) -> str:
    return f"t{at_s}"


SCAN = Strip(
    "/scan",
    LossTimeline.of([Slot(103, 1, {"replaced": 8}), Slot(104, 1, {"replaced": 2, "expired": 2})]),
    "12 of 90",
)
IMU = Strip("/imu", LossTimeline.of([Slot(110, 1, {"replaced": 1})], {"replaced": 4}), "5 of 900")


def test_text() -> None:
    assert strips_text([SCAN, IMU], 100.5, 109.2, 80, moment) == [
        "/scan: 12 of 90",
        "▁▁▁█▅▁▁▁▁▁▁",
        "  t103 (3 s), 2 s: 2 expired, 10 replaced",
        "/imu: 5 of 900",
        "▁▁▁▁▁▁▁▁▁▁█",
        "  t110 (10 s), 1 s: 1 replaced",
        "  time unknown: 4 replaced",
        "0 s    11 s, a bar for 1 s",
    ]


def test_a_long_time_has_wider_bars() -> None:
    lines = strips_text([SCAN], 0, 1000, 20, moment)
    assert lines[1] == "▁▁█▁▁▁▁▁▁▁▁▁▁▁▁▁▁▁▁▁"
    assert lines[-1].endswith("1000 s, a bar for 50 s")
    assert len(strips_text([SCAN], 0, 10**6, 10**4, moment)[1]) <= 120


def test_a_picture_has_a_bar_for_each_reason_with_its_figures() -> None:
    root = ElementTree.fromstring(strips_svg([SCAN, IMU], 100, 111, "Losses", moment))
    titles = [one.text for one in root.iter(f"{SVG}title")]
    assert titles == [
        "Losses",
        "t104, 1 s: 2 expired",
        "t103, 1 s: 8 replaced",
        "t104, 1 s: 2 replaced",
        "t110, 1 s: 1 replaced",
    ]
    bars = [one for one in root.iter(f"{SVG}rect") if one.find(f"{SVG}title") is not None]
    expired, most, on_top, other = bars
    assert expired.get("fill") != most.get("fill") == on_top.get("fill")
    assert (
        float(most.get("height", "")) == 4 * float(on_top.get("height", "")) == float(other.get("height", ""))
    )
    assert float(on_top.get("y", "")) == float(expired.get("y", "")) - float(on_top.get("height", ""))
    assert [one.text for one in root.iter(f"{SVG}text") if one.text and one.text.endswith(" s")] == [
        "0 s", "2 s", "4 s", "6 s", "8 s", "10 s",
    ]  # fmt: skip


def test_names_of_strangers_are_texts() -> None:
    text = strips_svg([SCAN._replace(name="/<script>&")], 100, 111, "</title><script>", moment)
    assert "<script>" not in text
    root = ElementTree.fromstring(text)
    assert "/<script>&" in [one.text for one in root.iter(f"{SVG}tspan")]


@pytest.mark.parametrize(
    ("span_s", "step"), [(1, 1), (8, 1), (9, 2), (60, 10), (100, 15), (3600, 600), (86400 * 20, 86400 * 3)]
)
def test_ticks(span_s: int, step: int) -> None:
    assert tick_step(span_s) == step
