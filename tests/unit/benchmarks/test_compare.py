"""benchmarks.compare: the threshold of a change, the report on all other rows, and files without results."""

import sys
from pathlib import Path

import msgspec
import pytest

from benchmarks import compare, report
from benchmarks.compare import differ, judge, render
from benchmarks.figures import Spread
from benchmarks.machine import Machine
from benchmarks.report import Column, Comparison, Result, Row, Section

pytestmark = pytest.mark.landing

MACHINE = Machine("Some CPU", 2, True, 8.0, "Linux 6", "CPython 3.11", {"msgspec": "0.19"}, "abc", 0.5)
COLUMNS = [
    Column("p50", "µs: p50", "lower"),
    Column("p99", "p99", "lower"),
    Column("per_s", "messages/s", "higher"),
]


def result(*rows: Row, machine: Machine = MACHINE, goal: float = 1.0) -> Result:
    comparisons = [Comparison("ours / theirs", Spread(0.9, 0.8, 1.0), at_most=goal)]
    section = Section("latency", "Latency", COLUMNS, list(rows), comparisons)
    return Result(report.FORMAT, "2025-01-02T03:04:05Z", False, 3, machine, [section])


def row(name: str = "busd", **figures: Spread) -> Row:
    return Row(name, figures)


@pytest.mark.parametrize(
    ("before", "after", "better", "verdict"),
    [
        (Spread(100, 98, 102), Spread(150, 147, 153), "lower", "worse"),
        (Spread(100, 98, 102), Spread(150, 147, 153), "higher", "better"),
        (Spread(100, 98, 102), Spread(150, 147, 153), "", "changed"),
        (Spread(150, 147, 153), Spread(100, 98, 102), "lower", "better"),
        (Spread(100, 80, 120), Spread(130, 110, 150), "lower", "same"),  # the spreads overlap
        (Spread(100, 95, 105), Spread(115, 110, 120), "lower", "same"),  # they overlap if widened by half
        (Spread(100, 99.9, 100.1), Spread(104, 103.9, 104.1), "lower", "same"),  # the change is too small
        (Spread(100, 100, 100), Spread(120, 120, 120), "lower", "same"),  # one repetition each
        (Spread(100, 100, 100), Spread(130, 130, 130), "lower", "worse"),
        (Spread(0, 0, 0), Spread(3, 3, 3), "lower", "worse"),
        (Spread(3, 3, 3), Spread(0, 0, 0), "lower", "better"),
        (Spread(0, 0, 0), Spread(0, 0, 0), "lower", "same"),
    ],
)
def test_a_change_is_more_than_noise(before: Spread, after: Spread, better: str, verdict: str) -> None:
    assert judge(before, after, better)[1] == verdict


def test_the_threshold_can_be_set() -> None:
    assert judge(Spread(100, 99, 101), Spread(110, 109, 111), "lower", 0.2)[1] == "same"
    assert judge(Spread(100, 99, 101), Spread(110, 109, 111), "lower", 0.05)[1] == "worse"


def test_changes_are_shown_by_size_and_the_rest_only_when_asked_for() -> None:
    small, large, same = (Spread(m, m - 1, m + 1) for m in (120, 300, 100))
    before = result(row("a", p50=same, p99=same, per_s=same))
    found = differ(before, result(row("a", p50=small, p99=large, per_s=same)))

    text = render(found)

    assert text.index("a; µs: p99") < text.index("a; µs: p50")
    assert "3.00x" in text and "worse" in text and "messages/s" not in text
    assert "a; messages/s" in render(found, show_all=True)
    assert text.splitlines()[0] == "the same machine and versions, and as thorough"
    assert text.endswith("3 figures: 0 better, 2 worse, 0 changed, 1 the same within noise\n")


def test_what_else_differs_is_said_first() -> None:
    other = msgspec.structs.replace(
        MACHINE, kernel="Linux 7", packages={"msgspec": "0.20", "pyzmq": "26"}, servers={"nats-server": "2"}
    )
    after = msgspec.structs.replace(result(row(), machine=other), is_quick=True, repetitions=1)

    assert differ(result(row()), after).warnings == [
        "A is a full run, B a quick one",
        "repetitions: 3 in A, 1 in B",
        "kernel: Linux 6 in A, Linux 7 in B",
        "msgspec: 0.19 in A, 0.20 in B",
        "pyzmq: missing in A, 26 in B",
        "nats-server: missing in A, 2 in B",
    ]


def test_rows_of_one_side_troubles_and_goals_are_named() -> None:
    one = Spread(1, 0.9, 1.1)
    found = differ(
        result(row("a", p50=one), row("gone", p50=one)),
        result(row("a", p50=one), Row("new", trouble="failed: it hangs"), goal=0.5),
    )

    assert found.only == ["only in A: latency: gone", "only in B: latency: new"]
    assert found.failed == ["B: latency: new: failed: it hangs"]
    assert found.goals == [
        "latency: ours / theirs: 0.900 (0.800 - 1.00), then 0.900 (0.800 - 1.00): NOT met any more"
    ]
    assert [change.verdict for change in found.changes] == ["same"]


def _main(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["compare", *map(str, arguments)])
    return compare.main()


def test_two_files_are_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.json"
    report.save(result(row(p50=Spread(1, 0.9, 1.1))), path)

    assert _main(monkeypatch, path, path) == 0
    assert "1 figures: 0 better" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (None, "a.json: No such file or directory"),
        ("hello", "a.json: is no result of a benchmark: "),
        ('{"format": 1}', "a.json: is of format 1, and only 2 can be read"),
        ('{"format": 2}', "a.json: is no result of a benchmark: Object missing required field"),
    ],
)
def test_a_file_that_is_no_result_is_said_so(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    content: str | None,
    error: str,
) -> None:
    path = tmp_path / "a.json"
    if content is not None:
        path.write_text(content)

    assert _main(monkeypatch, path, path) == 2
    assert error in capsys.readouterr().err
