"""benchmarks.merge: a saved result gets figures only of the same product, machine and versions."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from benchmarks import merge, report
from benchmarks.__main__ import main
from benchmarks.machine import ROOT, Machine, changes_since, look_at_machine
from benchmarks.plan import BENCHMARKS
from benchmarks.report import Result, Row, Section, Unreadable

pytestmark = pytest.mark.landing

MACHINE = Machine("Some CPU", 2, True, 8.0, "Linux 6", "CPython 3.11", {"pyzmq": "27"}, "abc", 0.5)
RESULT = Result(report.FORMAT, "2025-01-02T03:04:05Z", False, 5, MACHINE, [])


def section(name: str, title: str = "") -> Section:
    return Section(name, title, [], [])


def test_a_section_takes_its_place_or_that_of_an_older_one() -> None:
    order = ("latency", "cost", "bags")
    found = RESULT

    for one in (section("bags"), section("removed"), section("latency", "old"), section("latency", "new")):
        found = merge.add(found, one, order)

    assert [(one.name, one.title) for one in found.sections] == [
        ("latency", "new"),
        ("bags", ""),
        ("removed", ""),
    ]
    assert RESULT.sections == []


@pytest.mark.parametrize(
    ("present", "changed", "reason"),
    [
        (RESULT, [], ""),
        (RESULT, None, "git does not know the files that it measured, of commit abc"),
        (RESULT, ["busd/a.py", "busd/b.py"], "busd/a.py has changed since its commit abc"),
        (
            msgspec.structs.replace(RESULT, repetitions=2),
            [],
            "repetitions: 5 in A, 2 in B (A: the file, B: this run)",
        ),
        (
            msgspec.structs.replace(RESULT, is_quick=True),
            [],
            "A is a full run, B a quick one (A: the file, B: this run)",
        ),
        (
            msgspec.structs.replace(
                RESULT, machine=msgspec.structs.replace(MACHINE, packages={"pyzmq": "28"})
            ),
            [],
            "pyzmq: 27 in A, 28 in B (A: the file, B: this run)",
        ),
        (
            msgspec.structs.replace(RESULT, machine=msgspec.structs.replace(MACHINE, commit="def", load=3.0)),
            [],
            "",
        ),
    ],
)
def test_a_difference_is_a_reason_to_refuse(present: Result, changed: list[str] | None, reason: str) -> None:
    assert merge.obstacle_between(RESULT, present, changed) == reason


def test_changes_since_a_commit_are_those_of_git() -> None:
    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", ROOT, *arguments], capture_output=True, text=True, check=False
        ).stdout.strip()

    head = git("rev-parse", "--short=12", "HEAD")
    if not head:
        pytest.skip("this tree is not under git")
    assert (
        changes_since(head)
        == git("diff", "--name-only", "HEAD", "--", "busd", "clients", "setup.py").splitlines()
    )
    assert changes_since(f"{head}+") is None
    assert changes_since("") is None
    assert changes_since("0123456789ab") is None


def test_a_result_that_can_not_be_continued_is_left_alone(tmp_path: Path) -> None:
    machine = msgspec.structs.replace(look_at_machine(), commit="0123456789ab")
    path = tmp_path / "saved.json"
    report.save(msgspec.structs.replace(RESULT, machine=machine), path)
    before = path.read_bytes()

    with pytest.raises(Unreadable, match=r"saved\.json can't be continued: git does not know"):
        merge.base(path, RESULT)
    command = [sys.executable, "-m", "benchmarks", "--only", "memory", "--into", str(path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)

    assert (done.returncode, done.stdout) == (2, "")
    assert "of commit 0123456789ab" in done.stderr
    assert path.read_bytes() == before


def test_a_run_that_is_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "saved.json"
    done = [section(name) for name in BENCHMARKS if name not in ("latency", "bags")]
    report.save(msgspec.structs.replace(RESULT, machine=look_at_machine(), sections=done), path)
    monkeypatch.setattr(merge, "changes_since", lambda commit: [])
    monkeypatch.setattr("benchmarks.__main__.end_on_signals", lambda: None)
    row = Row("busd", trouble="failed: no room")
    measures = {
        "benchmarks.latency": lambda plan: section("latency"),
        "benchmarks.bags": lambda plan: Section("bags", "Bags", [], [row]),
    }
    monkeypatch.setattr(
        "benchmarks.__main__.import_module", lambda name: SimpleNamespace(run=measures.pop(name))
    )
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--into", str(path)])

    assert main() == 1  # a row has failed
    assert main() == 0
    assert f"{path} has all benchmarks" in capsys.readouterr().out
    assert [one.name for one in report.load(path).sections] == list(BENCHMARKS)
    assert [one.name for one in tmp_path.iterdir()] == ["saved.json"]
