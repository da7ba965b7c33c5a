"""benchmarks/: arithmetic, tables, and child processes: a benchmark waits for no dead child and leaves none
running.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path
from time import monotonic_ns

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import paced, report
from benchmarks.cases import Case, Figures, Outcome, interleave
from benchmarks.figures import Spread, per_100k, percentiles, ratios
from benchmarks.harness import Failure
from benchmarks.machine import ROOT, Machine, look_at_machine
from benchmarks.report import Column, Comparison, Result, Row, Section
from benchmarks.work import Stamped, Work, arrivals, text_of

pytestmark = pytest.mark.landing

MACHINE = Machine("Some CPU", 2, True, 8.0, "Linux 6", "CPython 3.11", {"msgspec": "0.19"}, "abc+", 0.5)

# --- arithmetic


def test_percentiles_are_named_sorted_and_scaled() -> None:
    found = percentiles([3000, 1000, 2000], prefix="due_", scale=1e-3)

    assert found == {"due_p50": 2.0, "due_p90": 3.0, "due_p99": 3.0, "due_p99.9": 3.0, "due_max": 3.0}


def test_spread_is_median_and_extremes_and_cost_is_for_100000_messages() -> None:
    assert Spread.of(iter([5, 1, 9, 2])) == Spread(median=3.5, min=1, max=9)
    assert per_100k(3.0, 600_000) == pytest.approx(0.5)
    with pytest.raises(ValueError, match="no values"):
        Spread.of([])


def test_ratios_pair_repetitions_and_pass_over_what_is_not_there() -> None:
    ours: list[Figures] = [{"p50": 4.0}, {"p50": 9.0}, {}, {"p50": 1.0}, {"p50": 1.0}]
    theirs: list[Figures] = [{"p50": 2.0}, {"p50": 3.0}, {"p50": 1.0}, {"p50": 0.0}]

    assert ratios(ours, theirs, "p50") == [2.0, 3.0]
    assert ratios([{"a": 6.0}], [{"b": 2.0}], "a", "b") == [3.0]


def test_arrivals_tell_lateness_and_age_and_leave_the_warm_up_out() -> None:
    work = Work(size=64, count=2, warm_up=1, rate=1000)
    texts = ["0 999", "1000 1010   ", "2000 2500   "]

    found = arrivals(texts, [99999, 1030, 2600], work)

    assert found.late_ns == [10, 500]
    assert found.age_ns == [20, 100]
    assert paced.summary(found)["due_max"] == pytest.approx(0.6)


def test_text_has_one_byte_a_character() -> None:
    assert all(len(text_of(size).encode()) == size for size in (0, 1, 64, 1 << 20))


# --- cases


def test_cases_take_turns_there_and_back() -> None:
    done: list[str] = []

    def case(name: str) -> Case:
        def measure() -> Figures:
            done.append(name)
            return {"n": float(len(done))}

        return Case(name, measure)

    outcomes = interleave([case("a"), case("b")], 3)

    assert "".join(done) == "abbaab"
    assert outcomes["a"].spreads() == {"n": Spread(4.0, 1.0, 5.0)}


def test_a_case_that_failed_or_is_missing_is_not_tried_again_and_the_others_go_on() -> None:
    tries: list[str] = []

    def fails() -> Figures:
        tries.append("fails")
        raise Failure("it hangs")

    def works() -> Figures:
        return {"n": 1.0}

    outcomes = interleave(
        [Case("fails", fails), Case("missing", fails, "not installed"), Case("works", works)], 2
    )

    assert tries == ["fails"]
    assert Row.of(outcomes["fails"]).trouble == "failed: it hangs"
    assert Row.of(outcomes["missing"]).trouble == "missing: not installed"
    assert len(outcomes["works"].repetitions) == 2


# --- paced messages


@given(st.sampled_from([64, 100, 1 << 20]), st.integers(0, 2**62))
def test_a_message_is_complete_before_its_stamp_which_changes_no_other_text(size: int, due_ns: int) -> None:
    twin = f"{due_ns} ".ljust(size)
    begin_ns = monotonic_ns()

    text, data = (Stamped(size, due_ns, kind).now() for kind in (str, bytes))

    end_ns = monotonic_ns()
    assert isinstance(text, str) and isinstance(data, bytes)
    assert len(text) == len(data) == size and text.isascii()
    for head in (text[:64], data[:64].decode()):
        due, sent = map(int, head.split())
        assert due == due_ns and begin_ns <= sent <= end_ns
    assert twin.split() == [str(due_ns)]


# --- reports


def test_numbers_have_three_digits_that_count() -> None:
    values = [0, 0.00123456, 0.5, 2.346, 94.06, 999.4, 1273.4, 99_999, 755_626, 999_999, 6.74e9, -2.5]

    texts = " ".join(map(report.number, values))

    assert texts == "0 0.00123 0.500 2.35 94.1 999 1273 100k 756k 1.00M 6.74G -2.50"


def test_table_aligns_its_columns() -> None:
    text = report.table(["what", "µs", "n"], [["busd", "9.50 (8 - 11)", "1"], ["two bare hops", "-"]])

    assert text.splitlines() == [
        "what                      µs  n",
        "-------------  -------------  -",
        "busd           9.50 (8 - 11)  1",
        "two bare hops              -",
    ]


def test_section_shows_figures_troubles_goals_and_notes() -> None:
    outcome = Outcome("busd", [{"p50": 4.0}, {"p50": 6.0}, {"p50": 5.0}])
    section = Section(
        "latency",
        "Latency",
        [Column("p50", "µs: p50"), Column("p99", "p99")],
        [
            Row.of(outcome),
            Row.of(Outcome("rival", failure="it hangs")),
            Row.of(Outcome("other", missing="none")),
        ],
        [
            Comparison("busd / floor", Spread(2.5, 2.0, 3.0), at_most=2.0),
            Comparison("messages/s", Spread(2e6, 1e6, 3e6), at_least=1e6),
            *report.compare("without a goal", [1.0]),
            *report.compare("nothing to compare", []),
        ],
        ["one way"],
    )

    assert section.has_failures
    assert report.render(section).splitlines() == [
        "Latency",
        "=======",
        "median (min - max)             µs: p50  p99",
        "------------------  ------------------  ---",
        "busd                5.00 (4.00 - 6.00)    -",
        "rival                                -    -",
        "other                                -    -",
        "rival: failed: it hangs",
        "other: missing: none",
        "",
        "busd / floor: 2.50 (2.00 - 3.00)   goal: at most 2.00, NOT met",
        "messages/s: 2.00M (1.00M - 3.00M)   goal: at least 1.00M, met",
        "without a goal: 1.00",
        "* one way",
    ]


def test_a_table_in_parts_has_in_each_the_rows_that_have_a_figure_there() -> None:
    first, second = ([f"{kind}{number}" for number in range(10)] for kind in ("latency", "time"))
    columns = [Column(key, f"the {key} of all that came") for key in (*first, *second)]
    one = Row("one", dict.fromkeys(first, Spread(1, 1, 1)))
    other = Row("other", dict.fromkeys(second, Spread(2, 2, 2)))

    parts = report.render(
        Section("n", "t", columns, [one, other, Row("neither", trouble="failed: x")], [])
    ).split("\n\n")

    assert all("one " in part or "other " in part for part in parts)
    assert not any("one " in part for part in parts if "latency" not in part)
    assert not any("other " in part for part in parts if "time" not in part)
    assert parts[-1].count("neither") == 1  # the reason why it has no figures


def test_result_is_saved_and_read_again(tmp_path: Path) -> None:
    section = Section(
        "idle", "Idle", [Column("n", "n")], [Row("a", {"n": Spread(1, 0, 2)}), Row("b", trouble="x")]
    )
    result = Result(report.FORMAT, "2025-01-02T03:04:05Z", True, 3, MACHINE, [section])
    path = tmp_path / "results" / report.file_name(result)

    report.save(result, path)

    assert path.name == "20250102T030405Z-abc-quick.json"
    assert report.load(path) == result


def test_machine_facts_name_neither_host_nor_paths() -> None:
    facts = look_at_machine()

    text = facts.describe()

    assert facts.cpus > 0 and facts.python.split()[0] in text
    assert os.uname().nodename not in text and str(ROOT) not in text and str(Path.home()) not in text


# --- processes


def test_an_interrupted_run_says_so_and_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    command = [sys.executable, "-m", "benchmarks", "--only", "throughput", "--no-save"]
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert run.stdout is not None
        run.stdout.readline()
        run.send_signal(signal.SIGTERM)
        _, errors = run.communicate(timeout=60)
    finally:
        run.kill()
        run.communicate()

    assert run.returncode == 130
    assert errors.strip().endswith("interrupted; nothing saved")
    assert not list(tmp_path.iterdir())
