"""Notes about routes in that outlive a process."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bus_bridge.core import journal as module
from bus_bridge.core.journal import Journal

A, B, C = b"a" * 16, b"b" * 16, b"c" * 16
SECOND = 1_000_000_000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal"


@pytest.fixture
def journal(path: Path) -> Iterator[Journal]:
    opened = Journal(path, 5 * SECOND)
    yield opened
    opened.close()


def noted(journal: Journal, gid: bytes, last: int, *listeners: bytes) -> None:
    entry = journal.begin(gid)
    assert entry is not None
    entry.note(last, 77)
    entry.note_listeners(frozenset(listeners))


def test_the_next_process_finds_where_a_route_ended_once(path: Path, journal: Journal) -> None:
    noted(journal, A, 9, B, C)
    journal.close()
    after = Journal(path, 6 * SECOND)
    assert after.take(B) is None
    past = after.take(A)
    assert past is not None
    assert (past.last, past.newest_ns, past.listeners) == (9, 77, {B, C})
    assert (past.numbering, past.lost_before, past.account.losses) == ("", {}, {})
    assert after.take(A) is None
    after.close()


def test_notes_survive_a_process_that_did_not_need_them(path: Path, journal: Journal) -> None:
    noted(journal, A, 9, B)
    journal.close()
    killed = Journal(path, 6 * SECOND)
    noted(killed, C, 3)
    killed.close()
    after = Journal(path, 7 * SECOND)
    found = [after.take(gid) for gid in (A, C)]
    assert [one and one.last for one in found] == [9, 3]
    after.close()


def test_ended_routes_and_routes_without_a_message_leave_nothing(path: Path, journal: Journal) -> None:
    ended = journal.begin(A)
    assert ended is not None
    ended.note(4, 77)
    ended.end()
    journal.begin(B)
    journal.close()
    after = Journal(path, 6 * SECOND)
    assert after.take(A) is after.take(B) is None
    after.close()


def test_of_many_listeners_some_are_enough(path: Path, journal: Journal) -> None:
    listeners = [bytes([number]) * 16 for number in range(20)]
    noted(journal, A, 1, *listeners)
    journal.close()
    after = Journal(path, 6 * SECOND)
    past = after.take(A)
    assert past is not None
    assert past.listeners == frozenset(listeners[:8])
    after.close()


def test_entries_are_bounded_and_used_again(path: Path) -> None:
    journal = Journal(path, 0, most=2)
    first, second = journal.begin(A), journal.begin(B)
    assert first is not None
    assert second is not None
    assert journal.begin(C) is None
    first.end()
    again = journal.begin(C)
    assert again is not None
    again.note(3, 77)
    second.note(2, 77)
    journal.close()
    after = Journal(path, 0, most=2)
    assert [after.take(gid) is not None for gid in (A, B, C)] == [False, True, True]
    after.close()


@pytest.mark.parametrize(("now_s", "is_known"), [(604, True), (606, False), (4, False)])
def test_notes_without_a_sign_of_life_are_void(
    path: Path, journal: Journal, now_s: int, is_known: bool
) -> None:
    """Also those of a clock that is set back, as after a start of the machine."""
    noted(journal, A, 9)
    journal.close()
    after = Journal(path, now_s * SECOND)
    assert (after.take(A) is not None) is is_known
    after.close()


def test_a_sign_of_life_keeps_them(path: Path, journal: Journal) -> None:
    noted(journal, A, 9)
    journal.live(100 * SECOND)
    journal.close()
    after = Journal(path, 650 * SECOND)
    assert after.take(A) is not None
    after.close()


def test_notes_before_a_start_of_the_machine_are_void(
    path: Path, journal: Journal, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted(journal, A, 9)
    journal.close()
    monkeypatch.setattr(module, "_BOOT_ID", path.with_name("none"))
    after = Journal(path, 6 * SECOND)
    assert after.take(A) is None
    after.close()


@pytest.mark.parametrize("content", [b"", b"?" * 100, b"\xff" * 1_000_000])
def test_a_file_of_something_else_is_replaced(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    journal = Journal(path, 0)
    noted(journal, A, 9)
    journal.close()
    after = Journal(path, 0)
    assert after.take(A) is not None
    after.close()


def test_two_bridges_do_not_share_a_file(path: Path, journal: Journal) -> None:
    with pytest.raises(BlockingIOError):
        Journal(path, 6 * SECOND)


def test_new_routes_take_the_places_of_old_notes(path: Path) -> None:
    journal = Journal(path, 0, most=2)
    for gid in (A, B):
        noted(journal, gid, 9)
    journal.close()
    after = Journal(path, 0, most=2)
    noted(after, C, 3)
    assert sorted(after.take(gid) is not None for gid in (A, B)) == [False, True]
    noted(after, A, 4)
    assert after.begin(B) is None
    after.close()
    last = Journal(path, 0, most=2)
    found = [last.take(gid) for gid in (A, B, C)]
    assert [one and one.last for one in found] == [4, None, 3]
    last.close()


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_a_file_that_others_may_write_is_not_used(path: Path, mode: int) -> None:
    """They could cut it while it is mapped."""
    path.touch()
    path.chmod(mode)
    with pytest.raises(PermissionError, match="other users may write it"):
        Journal(path, 0)


def test_a_link_is_not_followed(path: Path, tmp_path: Path) -> None:
    path.symlink_to(tmp_path / "other")
    with pytest.raises(OSError, match="symbolic links"):
        Journal(path, 0)
    assert not (tmp_path / "other").exists()
