"""benchmarks/soak.py: the detection of growth, counts, pictures, and one soak of a few seconds."""

import random
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import soak
from benchmarks.harness import Failure
from benchmarks.machine import ROOT
from benchmarks.soaking import picture, tables
from benchmarks.soaking.histogram import Histogram, Percentiles
from benchmarks.soaking.ledger import Ledger, Visit
from benchmarks.soaking.load import LATCHED, LISTENERS, STREAMS, TALKERS, head_of, route_of, text
from benchmarks.soaking.record import Record, Totals
from benchmarks.soaking.slope import Quantity, after_warm_up, fit
from benchmarks.soaking.usage import QUANTITIES, Usage
from bus_cli.bench.figures import percentile

pytestmark = pytest.mark.landing

MEMORY = Quantity("RSS MiB", step=2.0, per_hour=4.0, digits=1)
TWENTY_MINUTES = [5.0 * number for number in range(240)]
SMALL, LOSSY = STREAMS[0], next(stream for stream in STREAMS if stream.kind == "lossy")


def verdict(value: Callable[[float], float], times_s: list[float] = TWENTY_MINUTES) -> str:
    return fit(times_s, [value(at) for at in times_s]).verdict(MEMORY)


# --- growth


def test_a_line_is_found_exactly() -> None:
    line = fit([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0], [10.0 + at / 2 for at in range(8)])

    assert (line.slope, line.first, line.last) == pytest.approx((1800, 10, 13.5))
    assert line.error == pytest.approx(0, abs=1e-6)
    assert line.seconds == 7


def test_the_warm_up_is_the_first_third() -> None:
    assert after_warm_up([float(at) for at in range(10)]) == 3
    assert after_warm_up([]) == 0


@given(st.floats(8, 1e4), st.floats(0, 1e4))
def test_a_steady_leak_grows_and_what_shrinks_does_not(per_hour: float, begin: float) -> None:
    assert verdict(lambda at: begin + per_hour * at / 3600) == "grows"
    assert verdict(lambda at: begin - per_hour * at / 3600) == "flat"


@given(st.integers(0, 1 << 32), st.floats(0, 5))
def test_noise_is_flat_and_a_leak_within_it_grows(seed: int, noise: float) -> None:
    chance = random.Random(seed)
    assert verdict(lambda at: 40 + chance.gauss(0, noise)) == "flat"
    assert verdict(lambda at: 40 + chance.gauss(0, noise) + at / 20) == "grows"


@given(st.floats(0, 1200), st.floats(0, 1000))
def test_a_single_step_is_no_leak(at_s: float, step: float) -> None:
    assert verdict(lambda at: 40 + step * (at > at_s)) == "flat"


def test_a_leak_in_steps_grows() -> None:
    assert verdict(lambda at: 40 + at // 100) == "grows"


def test_noise_that_remembers_is_flat() -> None:
    chance, value = random.Random(7), 0.0

    def wander(at: float) -> float:
        nonlocal value
        value = 0.98 * value + chance.gauss(0, 0.2)
        return 40 + value

    assert [verdict(wander) for _ in range(50)] == ["flat"] * 50


def test_what_was_watched_too_short_is_not_judged() -> None:
    assert verdict(lambda at: at, [float(at) for at in range(59)]) == "too short"
    assert verdict(lambda at: at, [0.0, 100.0, 200.0]) == "too short"
    assert fit([], []).verdict(MEMORY) == "too short"


# --- latencies


@given(st.lists(st.integers(0, 10**10), min_size=1, max_size=200))
def test_a_histogram_says_little_more_than_what_was_measured(durations_ns: list[int]) -> None:
    halves = Histogram(), Histogram()
    for index, duration_ns in enumerate(durations_ns):
        halves[index % 2].add(duration_ns)
    halves[0].merge(halves[1])

    found = halves[0].percentiles()

    assert found is not None and found.samples == len(durations_ns)
    ordered = sorted(durations_ns)
    for percent, value_us in zip((50, 90, 99, 99.9, 100), found[1:], strict=True):
        true_us = percentile(ordered, percent) / 1000
        assert true_us <= value_us * 1.000001 and value_us <= max(true_us * 1.06, 0.0011)
    assert len(halves[0].counts) <= 12 * 34


def test_of_nothing_there_are_no_percentiles() -> None:
    assert Histogram().percentiles() is None


# --- messages


def test_a_message_says_whose_it_is_and_damage_is_seen() -> None:
    for stream in STREAMS:
        message = text("shm_talker_1", 7, 10**15, stream.size)
        assert len(message) == stream.size
        assert head_of(message, stream) == ("shm_talker_1", 7, 10**15)
        assert head_of(message[:-1] + "?", stream) is None
        assert head_of(message[:-1], stream) is None
    assert [route_of(TALKERS[0], LISTENERS[0]), route_of(TALKERS[0], LISTENERS[1])] == ["shm", "socket"]


def test_a_ledger_reports_what_is_missing_repeated_or_damaged_and_keeps_ages_by_talker() -> None:
    faults: list[str] = []
    ledger = Ledger(SMALL, faults.append)

    for number in (1, 2, 2, 5):
        ledger.note(text("a", number, 1000, SMALL.size), 3000)
    ledger.note(text("b", 1, 2000, SMALL.size), 3000)
    ledger.note("nonsense", 3000)

    assert [fault.removeprefix("soak_small: ") for fault in faults] == [
        "a: 2 after 2",
        "a: 3 to 4 are missing",
        "damaged: 'nonsense', 8 characters",
    ]
    ages = ledger.take_ages()
    assert {talker: sum(found.counts.values()) for talker, found in ages.items()} == {"a": 4, "b": 1}
    assert ages["b"].max_ns == 1000 and ledger.take_ages() == {}


def test_a_lossy_ledger_allows_gaps_only_and_not_thousands_of_lines() -> None:
    faults: list[str] = []
    ledger = Ledger(LOSSY, faults.append)

    for number in (3, 9, *[1] * 1000):
        ledger.note(text("a", number, 0, LOSSY.size), 1)

    assert faults[0] == "soak_lossy: a: 1 after 9" and len(faults) == 20


def visit(numbers: range, *, created_ns: int, talkers: int = 1) -> Visit:
    """A visit to one talker, which sends message n at n ns."""
    found = Visit(LATCHED, talkers)
    found.created(created_ns)
    for number in numbers:
        found.note(text("a", number, number, LATCHED.size))
    return found


def test_a_visit_hears_what_was_kept_and_goes() -> None:
    assert visit(range(31, 54), created_ns=50).is_over
    assert visit(range(31, 54), created_ns=50).verdict() == []
    assert not visit(range(31, 53), created_ns=50).is_over
    assert not visit(range(31, 54), created_ns=50, talkers=2).is_over
    assert visit(range(1, 9), created_ns=5).verdict() == []  # the talker sent nothing before message 1


def test_a_visit_that_hears_less_says_so() -> None:
    assert visit(range(32, 54), created_ns=50).verdict() == [
        "soak_latched: a late joiner: a: 19 of the 20 that were kept"
    ]
    broken = visit(range(31, 40), created_ns=50)
    broken.note(text("a", 41, 41, LATCHED.size))
    assert broken.is_over
    assert broken.verdict() == ["soak_latched: a late joiner: a: 41 after 39"]


# --- the record


def record() -> Record:
    """A record of half an hour, in which `busd` leaks descriptors and `talker` does not."""
    found = Record()
    ages = Histogram()
    for duration_ns in (10_000, 20_000, 900_000):
        ages.add(duration_ns)
    for number in range(1, 181):
        usage = {
            "busd": Usage(30.0, 20.0, 10.0 + number, 1.0, 5.0),
            "talker": Usage(40.0 + number % 2, 30.0, 10.0, 1.0, 5.0),
        }
        found.note_interval(10.0 * number, {"shm 100": [ages], "socket 1048576": []}, usage)
    found.published = {"a": 10, "b": 10}
    found.totals = {
        "one": Totals("a", "lossless", 10, 0, {}),
        "two": Totals("b", "lossy", 4, 0, {"replaced": 5, "expired": 1}),
    }
    return found


def test_accounts_close() -> None:
    found = record()
    assert found.open_accounts() == []
    assert found.drops() == {"replaced": 5, "expired": 1}

    found.totals["one"] = Totals("a", "lossless", 9, 0, {"replaced": 1})
    found.totals["two"] = Totals("b", "lossy", 3, 1, {"replaced": 6})
    assert found.open_accounts() == [
        "one lost messages: 10 published, 9 delivered, 0 queued, {'replaced': 1}",
        "the account of two is open: 10 published, 3 delivered, 1 queued, {'replaced': 6}",
    ]


def test_tables_name_what_grows() -> None:
    found = record()
    judged = found.judge(QUANTITIES)

    assert [(one.process, one.quantity.name) for one in judged if one.verdict == "grows"] == [
        ("busd", "descriptors")
    ]
    busd, talker = tables.usage_table(judged).splitlines()[2:]
    assert busd.endswith("GROWS: descriptors") and "+360.00 ± 0.00" in busd
    assert talker.endswith("flat")
    lines = tables.latency_table(found).splitlines()
    assert lines[2].split()[:7] == ["shm", "100", "B", "20.6", "900", "900", "900"]
    assert lines[2].split()[7] == "540" and len(lines) == 3
    assert "two" in tables.account_table(found) and "expired: 1, replaced: 5" in tables.account_table(found)


def test_many_failures_are_not_all_shown() -> None:
    lines = tables.failures_text([f"fault {number}" for number in range(100)]).splitlines()
    assert (lines[0], lines[-1], len(lines)) == ("FAILED: fault 0", "... and 70 more", 31)


def test_the_picture_shows_each_group_and_process(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    found = record()

    drawn = picture.draw(found, tmp_path / "x-soak.json")

    assert [path.name for path in drawn] == ["x-soak-light.svg", "x-soak-dark.svg"]
    for path in drawn:
        shown = path.read_text()
        assert all(words in shown for words in ("shm 100 B", "p99.9", "resident memory", "busd", "talker"))


# --- how it ends


def run_main(monkeypatch: pytest.MonkeyPatch, act: Callable[[Record], None], *arguments: str) -> int:
    """Run `main` with a soak that only does `act`."""

    def play(self: soak.Soak) -> None:
        act(self._record)

    monkeypatch.setattr(soak.Soak, "run", play)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr(sys, "argv", ["soak", *arguments])
    return soak.main()


def test_what_grows_fails_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def act(given: Record) -> None:
        given.__dict__.update(record().__dict__)

    monkeypatch.setitem(sys.modules, "benchmarks.soaking.picture", None)  # as without matplotlib
    assert run_main(monkeypatch, act, "--output", str(tmp_path)) == 1

    said = capsys.readouterr().out
    assert "FAILED: busd grows: descriptors by +360.00 ± 0.00 an hour" in said
    assert "no picture, it needs" in said
    (path,) = tmp_path.iterdir()
    saved = msgspec.json.decode(path.read_bytes(), type=soak.Result)
    assert len(saved.intervals) == 180 and saved.published == {"a": 10, "b": 10}
    assert saved.failures == ["busd grows: descriptors by +360.00 ± 0.00 an hour"]


def test_one_that_did_not_begin_says_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def act(_: Record) -> None:
        raise Failure("busd exited with 1")

    assert run_main(monkeypatch, act, "--no-save") == 1
    assert capsys.readouterr().out.splitlines()[-1] == "FAILED: busd exited with 1"


def test_an_interrupted_soak_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    command = [sys.executable, "-m", "benchmarks.soak", "--output", str(tmp_path / "results")]
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert run.stdout is not None
        assert any("a look every" in line for line in run.stdout)  # by now, all processes are started
        run.send_signal(signal.SIGTERM)
        _, errors = run.communicate(timeout=60)
    finally:
        run.kill()
        run.communicate()

    assert run.returncode == 130
    assert errors.strip() == "interrupted; nothing saved"
    assert not list(tmp_path.iterdir())


# --- the whole soak


def test_a_soak_of_seconds(tmp_path: Path) -> None:
    """Lossless topics lose nothing, each late joiner gets the kept messages, and all accounts balance."""
    command = [sys.executable, "-m", "benchmarks.soak", "--seconds", "2", "--output", str(tmp_path)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)

    assert (run.returncode, run.stderr) == (0, ""), run.stdout
    assert run.stdout.splitlines()[-1] == "nothing grew, nothing was lost that must not be"
    (path,) = tmp_path.glob("*-soak.json")
    found = msgspec.json.decode(path.read_bytes(), type=soak.Result)
    assert found.failures == [] and len(found.totals) == 5 * len(LISTENERS)
    assert min(found.published.values()) > 0
    for one in found.totals.values():
        assert one.delivered + one.lost == found.published[one.topic]
    processes = {name for interval in found.intervals for name in interval.usage}
    assert {"busd", *TALKERS, *LISTENERS} < processes
    groups: dict[str, Percentiles] = {}
    for interval in found.intervals:
        groups |= interval.latency
    assert {group.split()[0] for group in groups} >= {"socket"}
    assert all(0 < one.p50 <= one.p99 <= one.max for one in groups.values())


@pytest.mark.parametrize("wrong", ["0", "-1", "nan", "many", "90000"])
def test_a_wrong_length_is_refused(wrong: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        soak._parser().parse_args(["--minutes", wrong])
    assert f"{wrong} is not a number above 0" in capsys.readouterr().err
