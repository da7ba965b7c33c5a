"""Programs print the same under busd as under rclpy, except for docs/rclpy-differences.md."""

from pathlib import Path

import pytest

from bus.types.classes import message_class
from bus.types.definitions import find_path
from bus.types.support import type_hash
from differential import genuine, page
from differential.compare import PROGRAMS, SHARE, asks, difference, normalized, recorded, recording
from packaged import run_bus

WITH_ARRAYS = ("action_services", "actions")
"""Programs that print fixed-size arrays, which are NumPy arrays if NumPy is installed."""
every_program = pytest.mark.parametrize("name", PROGRAMS)


@pytest.mark.usefixtures("daemon")
@every_program
def test_the_facade_is_as_recorded(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in WITH_ARRAYS:
        pytest.importorskip("numpy")
    monkeypatch.setenv("BUS_INTERFACE_PATH", str(SHARE))
    done = run_bus("run", str(PROGRAMS[name]))
    assert done.code == 0, done.err
    assert difference(recorded(name), normalized(done.out)) == page.differences().get(name, [])


@pytest.mark.nightly
@every_program
def test_rclpy_is_as_recorded(name: str, tmp_path: Path) -> None:
    if reason := genuine.missing():
        pytest.skip(reason)
    done = genuine.run(PROGRAMS[name], tmp_path)
    assert done.code == 0, done.err
    assert normalized(done.out) == recorded(name)


@pytest.mark.nightly
def test_hashes_are_those_of_rclpy(monkeypatch: pytest.MonkeyPatch) -> None:
    if reason := genuine.missing():
        pytest.skip(reason)
    monkeypatch.setenv("BUS_INTERFACE_PATH", str(SHARE))
    theirs = genuine.hashes()
    names_here = [name for name in theirs if name.split("/")[1] == "msg" and find_path(name)]
    assert len(names_here) > 100
    assert {name: type_hash(message_class(name)) for name in names_here} == {
        name: theirs[name] for name in names_here
    }


def test_the_page_lists_the_programs() -> None:
    differs = page.differences()
    assert {name: asked for name, (asked, _) in page.rows().items()} == {
        name: asks(name) for name in PROGRAMS
    }
    assert {name for name, (_, outcome) in page.rows().items() if outcome != "same"} == set(differs)
    assert all(differs.values())


def test_nothing_is_recorded_of_a_program_that_is_gone() -> None:
    assert set(recording("").parent.iterdir()) == {recording(name) for name in PROGRAMS}
