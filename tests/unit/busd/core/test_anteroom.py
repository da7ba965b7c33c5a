"""busd.core.anteroom: places of connections that wait for admission, the next one to lose its place, the next
to enter.
"""

from busd.core.anteroom import Anteroom

ALICE, BOB = 1000, 1001


def displaced(room: Anteroom[str]) -> list[str]:
    """The connections that lose their places now, in order."""
    lost = []
    while room.is_overfull:
        lost.append(room.first_to_lose())
        room.leave(lost[-1])
    return lost


def fill(room: Anteroom[str], *keys: str, uid: int = ALICE, pid: int = 1) -> list[str]:
    lost = []
    for key in keys:
        room.enter(0, key, uid, pid)
        lost += displaced(room)
    return lost


def test_the_oldest_of_the_greediest_process_goes_first() -> None:
    room: Anteroom[str] = Anteroom(4)
    assert fill(room, "program", pid=1) == []
    assert fill(room, "a", "b", "c", "d", "e", pid=2) == ["a", "b"]
    assert fill(room, "late", pid=3) == ["c"]
    assert len(room) == 4


def test_a_user_who_takes_all_loses_to_another() -> None:
    """This is true for any number of processes."""
    room: Anteroom[str] = Anteroom(4)
    for pid in range(4):
        fill(room, f"a{pid}", pid=pid)
    assert fill(room, "b0", uid=BOB) == ["a0"]
    assert fill(room, "b1", uid=BOB) == ["a1"]
    assert fill(room, "b2", uid=BOB) == ["b0"]  # now BOB has more places


def test_who_has_said_hello_goes_after_who_has_not() -> None:
    """A connection that has said Hello loses its place last, within a process, and among processes with one
    place each. A process with more places loses first.
    """
    room: Anteroom[str] = Anteroom(3)
    fill(room, "first", "second", "third")
    room.on_hello(0, "first")
    assert fill(room, "fourth") == ["second"]
    room = Anteroom(2)
    fill(room, "program", pid=1)
    room.on_hello(0, "program")
    assert fill(room, "x", pid=2) == []
    assert fill(room, "y", pid=3) == ["x"]
    room.on_hello(0, "y")
    assert fill(room, "z", pid=3) == ["z"]


def test_each_user_waits_in_the_order_of_hello() -> None:
    room: Anteroom[str] = Anteroom()
    fill(room, "a", "b", "c")
    fill(room, "other", uid=BOB)
    assert room.users_waiting() == []
    assert room.first_waiting(ALICE) is None
    room.on_hello(5, "b")
    room.on_hello(6, "a")
    room.on_hello(7, "other")
    assert room.users_waiting() == [ALICE, BOB]
    assert room.first_waiting(ALICE) == ("b", 5)
    room.leave("b")
    assert room.first_waiting(ALICE) == ("a", 6)
    room.leave("a")
    assert room.users_waiting() == [BOB]


def test_who_is_silent_is_known_by_the_time_since() -> None:
    room: Anteroom[str] = Anteroom()
    for at, key in enumerate("abc"):
        room.enter(at, key, ALICE, at)
    assert room.silent() == ("a", 0)
    room.on_hello(9, "a")
    room.leave("b")
    assert room.silent() == ("c", 2)
    room.leave("c")
    assert room.silent() is None


def test_nothing_is_left_of_those_who_went() -> None:
    room: Anteroom[str] = Anteroom(2)
    fill(room, "a", "b", "c", pid=1)
    fill(room, "d", uid=BOB, pid=2)
    for key in "cd":
        room.on_hello(0, key)
        room.leave(key)
    assert not room
    assert (room._users, room._silent, room._owners) == ({}, {}, {})
