"""busd.server.admission: the cost of a connection until its Hello, the places in the queue, and reasons for
refusals.
"""

import asyncio
import errno
import logging
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from bus.wire.session import Role, Session
from busd.core.anteroom import MOST_WAITING
from busd.server import admission as module
from busd.server.admission import Admission
from busd.server.credentials import Credentials
from raw_peer import HELLO
from semantics import until

SECOND = 1_000_000_000
NO_PLACE = "busd has no place left for another waiting connection; try again"


class Host:
    """Lets everybody in unless a test changes that, and records each admission."""

    handshake_s = 60.0

    def __init__(self) -> None:
        self.inside: list[tuple[socket.socket, m.Hello]] = []
        self.stranger = self.full = ""
        self.wait_ns: Callable[[int], int] = lambda said_ns: 0
        self.failures: list[bool] = []

    def greeting(self) -> bytes:
        return m.encode_frame(m.Hello(version=PROTOCOL_VERSION, program="busd"))

    def why_turned_away(self, who: Credentials) -> str:
        return self.stranger

    def arrive(self, who: Credentials, said_ns: int) -> int:
        return self.wait_ns(said_ns)

    def why_no_room(self, who: Credentials) -> tuple[str, bool]:
        return self.full, False

    def count_failed_connection(self, who: Credentials, *, for_want_of_room: bool) -> tuple[bool, int]:
        self.failures.append(for_want_of_room)
        return len(self.failures) == 1, 0

    def let_in(self, sock: socket.socket, who: Credentials, hello: m.Hello) -> None:
        self.inside.append((sock, hello))


class Door:
    """An admission, its host, and its guests. Use it as `with`."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "busd.sock"
        self.host = Host()
        self.listening = socket.socket(socket.AF_UNIX)
        self.listening.bind(str(self.path))
        self.listening.listen(512)
        self.listening.setblocking(False)
        self._stack = ExitStack()

    def __enter__(self) -> "Door":
        self.admission = Admission(self.listening, self.host)
        return self

    def __exit__(self, *_: object) -> None:
        self.admission.close()
        self._stack.close()
        self.listening.close()
        for inside, _ in self.host.inside:  # type: ignore[assignment]
            inside.close()

    def come(self, words: bytes = b"") -> socket.socket:
        """One more connection, which has sent `words`."""
        guest = self._stack.enter_context(socket.socket(socket.AF_UNIX))
        guest.setblocking(False)
        guest.connect(str(self.path))
        if words:
            guest.send(words)
        return guest

    async def fill(self) -> list[socket.socket]:
        """Take all places."""
        guests = [self.come() for _ in range(MOST_WAITING)]
        await until(lambda: len(self.admission._anteroom) == MOST_WAITING)
        return guests


@pytest.fixture
def door(tmp_path: Path) -> Iterator[Door]:
    door = Door(tmp_path)
    yield door
    door.listening.close()


async def last_words(guest: socket.socket) -> list[Any]:
    """Everything that the other side sends until its end."""
    session, said = Session(Role.CLIENT), list[Any]()
    while size := await asyncio.get_running_loop().sock_recv_into(guest, session.reader.get_buffer()):
        said += session.received(size)
    return said


async def fault(guest: socket.socket) -> m.Fault:
    hello, last = await last_words(guest)
    assert isinstance(hello, m.Hello)
    assert isinstance(last, m.Fault)
    return last


class TestHello:
    async def test_who_says_it_is_let_in(self, door: Door) -> None:
        with door:
            door.come(HELLO + b"the rest")
            await until(lambda: door.host.inside)
            ((sock, hello),) = door.host.inside
            assert hello.program == "raw peer"
            assert sock.recv(100) == b"the rest"
            assert not sock.getblocking()
            assert door.admission.is_empty

    async def test_it_may_come_in_pieces(self, door: Door) -> None:
        with door:
            guest = door.come(HELLO[:3])
            await until(lambda: not door.admission.is_empty)
            for at in range(3, len(HELLO)):
                guest.send(HELLO[at : at + 1])
                await asyncio.sleep(0)
            await until(lambda: door.host.inside)
            assert door.admission.is_empty

    @pytest.mark.parametrize("words", [b"", HELLO[:9]])
    async def test_who_hangs_up_before_it_is_forgotten(self, door: Door, words: bytes) -> None:
        with door:
            guest = door.come(words)
            await until(lambda: not door.admission.is_empty)
            guest.close()
            await until(lambda: door.admission.is_empty)
            assert not door.host.failures

    async def test_who_does_not_say_it_in_time(self, door: Door) -> None:
        """One timer serves all connections, and each one has its own time limit."""
        door.host.handshake_s = 0.05
        with door:
            first = door.come()
            await until(
                lambda: not door.admission.is_empty or door.host.failures
            )  # on a slow machine, the time may be over already
            later = door.come(HELLO[:9])
            for guest in (first, later):
                assert await fault(guest) == m.Fault(text="no Hello within 0.05 s")
            assert door.host.failures == [False, False]

    async def test_one_that_came_while_nobody_looked_is_not_too_late(
        self, door: Door, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with door:
            guest = door.come()
            await until(lambda: not door.admission.is_empty)
            monkeypatch.setattr(module, "monotonic_ns", lambda: 1 << 62)
            monkeypatch.setattr(door.admission, "_poll", lambda: None)
            guest.send(HELLO)
            door.admission._tick()
            assert door.host.inside


class TestTurnedAway:
    """Each refused connection gets the reason, even if busd has not read all its data."""

    @pytest.mark.parametrize("garbage", [b"GET / HTTP/1.1\r\n", b"\xff" * 5000, HELLO[:6] + bytes(100_000)])
    async def test_with_garbage(self, door: Door, garbage: bytes) -> None:
        with door:
            refused = await fault(door.come(garbage))
            assert refused.text.startswith(("frame of", "control message not understood"))
            assert not refused.again

    async def test_strangers_are_told_without_a_word_of_theirs(
        self, door: Door, caplog: pytest.LogCaptureFixture
    ) -> None:
        """The log names each user once."""
        door.host.stranger = "you may not"
        with door:
            for _ in range(3):
                assert (await fault(door.come())).text == "you may not"
        assert [one.levelno for one in caplog.records if "you may not" in one.message] == [logging.WARNING]

    async def test_where_there_is_no_room_inside(self, door: Door) -> None:
        door.host.full = "3 of 3"
        with door:
            assert await fault(door.come(HELLO)) == m.Fault(text="3 of 3")

    async def test_at_the_end_nobody_says_a_word(self, door: Door) -> None:
        """The client treats this like the end of a busd with connections in its backlog, and tries again."""
        with door:
            guest = door.come()
            await until(lambda: not door.admission.is_empty)
            door.admission.close()
            assert await last_words(guest) == []


class TestPlaces:
    async def test_the_silent_do_not_keep_out_who_says_hello(self, door: Door) -> None:
        with door:
            await door.fill()
            for at in range(20):
                door.come(HELLO)
                await until(lambda at=at: len(door.host.inside) == at + 1)
            assert len(door.admission._anteroom) == MOST_WAITING
            assert not door.host.failures

    async def test_the_oldest_silent_one_makes_room_and_is_told_to_try_again(self, door: Door) -> None:
        with door:
            guests = await door.fill()
            door.come()
            assert await fault(guests[0]) == m.Fault(text=NO_PLACE, again=True)
            await until(lambda: len(door.admission._anteroom) == MOST_WAITING)
            assert door.host.failures == [True]

    async def test_not_one_whose_hello_is_there_and_was_not_read(
        self, door: Door, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with door:
            guests = await door.fill()
            monkeypatch.setattr(door.admission, "_poll", lambda: None)
            guests[0].send(HELLO)
            door.come()
            await until(lambda: door.host.inside)
            assert not door.host.failures
            door.come()
            assert (await fault(guests[1])).again

    async def test_newcomers_make_room_where_busd_is_out_of_descriptors(self, door: Door) -> None:
        class Full:
            def accept(self) -> Any:
                raise OSError(errno.EMFILE, "Too many open files")

        with door:
            guests = [door.come() for _ in range(3)]
            await until(lambda: len(door.admission._anteroom) == 3)
            door.admission._listening, listening = Full(), door.admission._listening  # type: ignore[assignment]
            assert door.admission.accept_some(5) == 0
            door.admission._listening = listening
            assert await fault(guests[0]) == m.Fault(text=NO_PLACE, again=True)
            assert len(door.admission._anteroom) == 2


class TestTurns:
    """A user with too many connections waits."""

    async def test_who_waits_is_let_in_when_it_is_time_and_in_order(self, door: Door) -> None:
        door.host.wait_ns = lambda said_ns: SECOND
        with door:
            words = [HELLO, m.encode_frame(m.Hello(version=PROTOCOL_VERSION, program="second"))]
            for number, hello in enumerate(words, 1):
                door.come(hello)
                await until(lambda number=number: len(door.admission._anteroom) == number)
            assert not door.host.inside
            door.host.wait_ns = lambda said_ns: 0
            door.admission._tick()
            assert [hello.program for _, hello in door.host.inside] == ["raw peer", "second"]

    async def test_nobody_overtakes_who_waits(self, door: Door) -> None:
        door.host.wait_ns = lambda said_ns: SECOND
        with door:
            door.come(HELLO)
            await until(lambda: not door.admission.is_empty)
            door.host.wait_ns = lambda said_ns: 0
            door.come(HELLO)
            await until(lambda: len(door.admission._anteroom) == 2)

    async def test_it_wakes_up_by_itself(self, door: Door) -> None:
        asked = list[int]()
        door.host.wait_ns = lambda said_ns: asked.append(said_ns) or (SECOND // 100 if len(asked) < 3 else 0)
        with door:
            door.come(HELLO)
            await until(lambda: door.host.inside)
            assert len(asked) == 3
            assert asked[1] == asked[2]  # both are the time of its Hello

    async def test_who_hangs_up_meanwhile_keeps_no_place(self, door: Door) -> None:
        door.host.wait_ns = lambda said_ns: SECOND
        with door:
            guest = door.come(HELLO + b"and more, which nobody reads")
            await until(lambda: not door.admission.is_empty)
            guest.close()
            await until(lambda: door.admission.is_empty)


class TestCost:
    async def test_so_many_at_once_and_no_more(self, door: Door) -> None:
        with door:
            for _ in range(5):
                door.come(HELLO)
            assert door.admission.accept_some(3) == 3
            assert len(door.host.inside) == 3
            assert door.admission.accept_some(3) == 2
            assert door.admission.accept_some(3) == 0

    async def test_one_that_gives_up_in_the_backlog_does_not_end_the_round(self, door: Door) -> None:
        """The kernel reports the error in its place; the connections behind it wait already."""

        class Aborting:
            def __init__(self, listening: socket.socket) -> None:
                self._listening = listening
                self._left = 2

            def accept(self) -> Any:
                if self._left:
                    self._left -= 1
                    raise ConnectionAbortedError
                return self._listening.accept()

        with door:
            door.come(HELLO)
            listening = door.admission._listening
            door.admission._listening = Aborting(listening)  # type: ignore[assignment]
            assert door.admission.accept_some(3) == 3
            door.admission._listening = listening
            assert len(door.host.inside) == 1

    async def test_all_together_take_a_quarter_of_the_time(
        self, door: Door, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The clock shows 5 ms more work at each look."""
        work_ns = 0

        def work() -> int:
            nonlocal work_ns
            work_ns += 5_000_000
            return work_ns

        monkeypatch.setattr(module, "thread_time_ns", work)
        monkeypatch.setattr(module, "monotonic_ns", lambda: SECOND)
        pauses = list[float]()
        with door:
            monkeypatch.setattr(door.admission, "_pause", pauses.append)
            for _ in range(4):
                door.admission._come()
        # Two times 5 ms are free; after that, the rest is four times as long as the work.
        assert pauses == [0.02, 0.04]

    async def test_after_its_rest_it_goes_on(self, door: Door) -> None:
        with door:
            door.admission._pause(0.01)
            door.come(HELLO)
            await asyncio.sleep(0)
            assert not door.host.inside
            await until(lambda: door.host.inside)
