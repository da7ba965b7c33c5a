"""The report, its pictures and the README's table: their texts, and the result that each is made from."""

import re
import sys
from pathlib import Path

import msgspec
import pytest

from benchmarks import markdown, pictures, report, write
from benchmarks.figures import Spread
from benchmarks.looks import is_main, look_of, system_of
from benchmarks.machine import Machine
from benchmarks.plan import BENCHMARKS
from benchmarks.report import Column, Comparison, Result, Row, Section
from benchmarks.systems import (
    BUS,
    BUS_SOCKET,
    C_FLOOR,
    ECAL,
    ICEORYX,
    NATS,
    PIPE,
    PYZMQ,
    PYZMQ_PROXY,
    SYSTEMS,
    tuned,
)

pytestmark = pytest.mark.landing

MACHINE = Machine("Some CPU", 2, True, 8.0, "Linux 6", "CPython 3.11", {"msgspec": "0.19"}, "abc", 0.5)
MIB = 1 << 20


def one(value: float) -> Spread:
    return Spread(value, value * 0.9, value * 1.1)


def latency() -> Section:
    rows = []
    series = {BUS.name: 10, PYZMQ.name: 40, NATS.name: 5, f"{BUS.name}, busy polling": 2}
    for size, text in ((64, "64 B"), (MIB, "1 MiB")):
        for name, value in series.items():
            figures = {"p50": one(value), "p99": one(value * 2), "p99.9": one(value * 3)}
            rows.append(Row(f"{text}, {name}", figures, "", name, size))
    rows.append(Row("1 MiB, iceoryx2", {}, "missing: iceoryx2 is not installed", ICEORYX.name, MIB))
    comparisons = [
        Comparison("64 B, ours / best rival, p50", Spread(2.0, 1.9, 2.1), at_most=1.0),
        Comparison("1 MiB, ours / best rival, p50", Spread(0.5, 0.4, 0.6), at_most=1.0),
    ]
    columns = [
        Column("p50", "µs: p50", "lower"),
        Column("p99", "p99", "lower"),
        Column("p99.9", "p99.9", "lower"),
    ]
    return Section("latency", "Latency", columns, rows, comparisons, ["a | note"], "size in B")


def cost() -> Section:
    figures = {key: one(2.0) for key in ("cpu", *pictures.PROCESSES)}
    columns = [Column("cpu", "CPU s per 100k: all", "lower"), Column("cpu_publisher", "publisher", "lower")]
    return Section("cost", "CPU time", columns, [Row(BUS.name, figures, "", BUS.name)])


def growth() -> Section:
    rows = [Row(f"{at} topics", {"p50": one(at)}, "", f"topics: {BUS.name}", at) for at in (1, 100)]
    return Section("growth", "Growth", [Column("p50", "µs: p50", "lower")], rows, axis="how many")


def result(*sections: Section) -> Result:
    return Result(report.FORMAT, "2025-01-02T03:04:05Z", False, 3, MACHINE, list(sections))


RESULT = result(latency(), cost(), growth())


def test_a_series_is_known_by_its_system() -> None:
    assert system_of(PYZMQ_PROXY.name) == PYZMQ_PROXY and system_of(PYZMQ.name) == PYZMQ
    assert system_of(f"{ICEORYX.name}, event-driven") == ICEORYX and system_of("codec alone") is None
    assert [is_main(name) for name in (BUS.name, f"{BUS.name}, async for", "codec alone")] == [
        True,
        False,
        False,
    ]
    assert (
        look_of(BUS.name).is_ours and look_of(BUS_SOCKET.name).is_ours and not look_of(C_FLOOR.name).is_ours
    )


def test_no_two_rivals_look_alike() -> None:
    looks = [look_of(system.name) for system in SYSTEMS if system.kind in ("direct", "brokered")]
    assert len(set(looks)) == len({look.marker for look in looks}) == len(looks)


def test_the_report_says_where_it_loses_and_what_is_missing() -> None:
    text = markdown.report_of(RESULT, "results/x.json")
    tables = markdown.tables_of(RESULT, "results/x.json")

    assert "1 of 2 goals are met. These are not:" in text
    assert "- latency: 64 B, ours / best rival, p50: **2.00 (1.90 - 2.10)**, goal at most 1.00" in text
    assert "- iceoryx2: missing: iceoryx2 is not installed (in latency at 1 MiB)" in text
    assert "These benchmarks: foreign, facade, throughput," in text
    assert "load 0.50 at the start" in text
    assert "| **busd, shared memory** | 10.0 | 10.0 |" in tables
    assert "| 1 MiB, ours / best rival, p50 | 0.500 (0.400 - 0.600) | at most 1.00 | met |" in tables
    assert "- a \\| note" in tables and "**NOT met**" in tables
    for picture in pictures.available(RESULT):
        assert all(f"pictures/{file}" in text for file in picture.files().values())


def test_the_goals_come_first_and_are_met_or_missed() -> None:
    asked = [
        Comparison("64 B, ours / theirs, p50", one(0.8), at_most=0.9, headline="64 B, p50 / theirs"),
        Comparison("64 B, ours, per_s", one(3e6), at_least=4e6, headline="64 B, messages/s"),
    ]
    section = msgspec.structs.replace(latency(), comparisons=[*asked, *latency().comparisons])

    text = markdown.report_of(result(section), "x.json")

    assert text.index("## In short") < text.index("## Goals") < text.index("## Where it loses")
    assert "1 of 2 are met." in text and "1 of 2 goals are met." in text  # the goals of the section beside it
    assert "| 64 B, p50 / theirs | 0.800 (0.720 - 0.880) | at most 0.900 | met |" in text
    assert "| 64 B, messages/s | 3.00M (2.70M - 3.30M) | at least 4.00M | **missed** |" in text
    assert "## Goals" not in markdown.report_of(RESULT, "x.json")


def test_the_readmes_table_has_long_messages_also_with_malloc_set_alike() -> None:
    rows = [
        Row(series, {"p50": one(value)}, "", series, MIB)
        for series, value in {
            BUS.name: 10.0,
            tuned(BUS).name: 9.0,
            PIPE.name: 90.0,
            tuned(PIPE).name: 18.0,
            f"{ICEORYX.name}, busy polling": 1.0,
        }.items()
    ]

    lines = markdown.speed_of(result(Section("latency", "", latency().columns, rows))).splitlines()

    assert lines[0] == "|  | 1 MiB: p50 µs | 1 MiB, malloc alike: p50 µs |"
    assert lines[2:4] == [
        "| **busd, shared memory** | **10.0** | **9.00** |",
        "| best rival without | 90.0 (9.00x) multiprocessing.Pipe | 18.0 (2.00x) multiprocessing.Pipe |",
    ]
    assert "*Malloc alike*" in lines[-1]
    assert "alloc" not in markdown.speed_of(RESULT)


def test_the_short_tables_have_ratios_and_tell_where_a_rival_is_ahead() -> None:
    whole = markdown.report_of(RESULT, "results/x.json").splitlines()
    short = markdown.speed_of(RESULT).splitlines()

    assert short[0] == "|  | latency 64 B: p50 µs | p99 µs | 1 MiB: p50 µs |"
    assert short[2:5] == [
        "| **busd, shared memory** | **10.0** | **20.0** | **10.0** |",
        "| best rival with a broker "
        "| 5.00 (**0.500x**) nats-py | 10.0 (**0.500x**) nats-py | 5.00 (**0.500x**) nats-py |",
        "| best rival without | 40.0 (4.00x) pyzmq | 80.0 (4.00x) pyzmq | 40.0 (4.00x) pyzmq |",
    ]
    assert "full run of 2025-01-02 at commit abc" in short[-1]
    assert "|  | latency 64 B: p50 µs | p99 µs | 1 MiB: p50 µs | CPU s per 100k |" in whole
    assert "| nats-py (a broker) | 5.00 (**0.500x**) | 10.0 (**0.500x**) | 5.00 (**0.500x**) | - |" in whole


def test_the_readmes_table_has_busd_the_best_rivals_of_each_column_and_a_limit() -> None:
    medians = [
        (BUS, 10, 20),
        (BUS_SOCKET, 30, 40),
        (C_FLOOR, 1, 2),
        (PIPE, 90, 90),
        (PYZMQ, 40, 80),
        (ICEORYX, 50, 81),
        (ECAL, 60, 9),
        (NATS, 15, 5),
        (PYZMQ_PROXY, 5, 15),
    ]
    rows = [
        Row(system.name, {"p50": one(p50), "p99": one(p99)}, "", system.name, 64)
        for system, p50, p99 in medians
    ]
    found = markdown.speed_of(result(Section("latency", "", latency().columns, rows))).splitlines()

    assert [line for line in found if line.startswith("| ")][2:] == [
        "| **busd, shared memory** | **10.0** | **20.0** |",
        "| **busd, socket** | 30.0 (3.00x) | 40.0 (2.00x) |",
        "| best rival with a broker | 5.00 (**0.500x**) pyzmq, XSUB/XPUB proxy | 5.00 (**0.250x**) nats-py |",
        "| best rival without | 40.0 (4.00x) pyzmq | 9.00 (**0.450x**) eclipse-ecal |",
        "| C, shared memory + eventfd (a limit) | 1.00 (0.100x) | 2.00 (0.100x) |",
    ]


def test_what_stands_between_the_marks_is_replaced_and_nothing_else() -> None:
    begin, end = markdown.SPEED
    text = f"before\n{begin}\nold\n{end}\nafter\n"

    assert markdown.with_speed(text, "new") == f"before\n{begin}\nnew\n{end}\nafter\n"
    assert markdown.between_marks(text) == "old"
    assert markdown.between_marks("no marks") is None
    with pytest.raises(ValueError, match="no <!-- speed -->"):
        markdown.with_speed("no marks", "new")


def test_a_result_without_figures_has_a_report() -> None:
    text = markdown.report_of(result(), "results/x.json")

    assert "## Pictures" not in text
    whole = markdown.report_of(result(*(Section(name, name, [], []) for name in BENCHMARKS)), "x.json")
    assert "Nothing: every case was measured." in whole and "These benchmarks" not in whole
    assert "Nothing was asked for" in text and "Every case of the others was measured." in text
    assert markdown.speed_of(result()) == "No result yet."
    assert pictures.available(result()) == []


def test_the_pictures_of_a_result_are_always_the_same(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    few = result(cost())

    first, second = (pictures.draw(few, tmp_path / name) for name in "ab")

    assert [path.name for path in first] == ["cost-light.svg", "cost-dark.svg"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert first[0].read_text() != first[1].read_text()
    assert "CPU s per 100,000 messages" in first[0].read_text()


def test_pictures_of_every_kind_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")

    drawn = pictures.draw(RESULT, tmp_path)

    assert {path.name.rpartition("-")[0] for path in drawn} == {"latency", "latency-sizes", "cost", "growth"}
    assert all("busd, shared memory" in path.read_text() for path in drawn)


def test_a_quick_run_makes_a_preview_and_no_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.json"
    report.save(msgspec.structs.replace(result(), is_quick=True), path)
    monkeypatch.setattr(sys, "argv", ["write", str(path)])

    assert write.main() == 2
    assert "is of a quick run" in capsys.readouterr().err
    monkeypatch.setattr(pictures, "draw", lambda result, folder: [])
    monkeypatch.setattr(sys, "argv", ["write", str(path), "--preview", str(tmp_path / "p")])
    assert write.main() == 0
    assert (tmp_path / "p" / "speed.md").read_text() == "No result yet.\n"


def test_report_and_readme_are_of_the_result_that_they_name() -> None:
    """If no report is committed, the README has no table of speeds."""
    speed = markdown.between_marks(write.README.read_text())
    assert speed is not None
    if not write.REPORT.exists():
        assert speed == ""
        return
    text = write.REPORT.read_text()
    source = re.search(r"\[(results/[^\]]+\.json)\]", text)
    assert source is not None
    found = report.load(write.REPORT.parent / source[1])

    assert not found.is_quick
    assert text == markdown.report_of(found, source[1])
    assert (write.REPORT.parent / markdown.TABLES).read_text() == markdown.tables_of(found, source[1])
    assert speed == markdown.speed_of(found)
    drawn = {file for picture in pictures.available(found) for file in picture.files().values()}
    assert {path.name for path in (write.REPORT.parent / markdown.FOLDER).glob("*.svg")} == drawn
