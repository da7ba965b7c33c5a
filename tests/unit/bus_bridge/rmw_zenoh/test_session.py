"""bus_bridge.rmw_zenoh.session: two sessions on loopback; the thread for what has to wait."""

import asyncio
import threading
from collections.abc import AsyncIterator
from typing import Any

import pytest

from bridged_world import until

pytest.importorskip("zenoh", reason="needs the extra rmw-zenoh: make setup installs it")

from bus_bridge.rmw_zenoh import session as module
from bus_bridge.rmw_zenoh.session import Asking, Question, RosOutlet, RosSession
from rmw_zenoh_sessions import linked, zenoh_runs

__all__ = ["zenoh_runs"]

KEY = "0/a/b"


@pytest.fixture
async def sessions() -> AsyncIterator[tuple[RosSession, RosSession]]:
    async with linked() as both:
        yield both


@pytest.mark.parametrize("waits", [False, True])
async def test_messages_arrive_in_order(sessions: tuple[RosSession, RosSession], waits: bool) -> None:
    one, other = sessions
    heard: list[tuple[bytes, bytes]] = []
    other.hear(KEY, lambda *message: heard.append(message), with_history=False)
    own: list[bytes] = []
    one.hear(KEY, lambda payload, head: own.append(payload), with_history=False)
    changes: list[bool] = []
    outlet = RosOutlet(one, KEY, lambda: changes.append(outlet.is_wanted), None, waits=waits)
    await until(lambda: outlet.is_wanted)
    for number in range(5):
        assert outlet.put(b"%d" % number, b"head")
    outlet.undeclare()
    await until(lambda: len(heard) == 5)
    assert heard == [(b"%d" % number, b"head") for number in range(5)]
    assert own == []  # not to ourselves
    assert changes == [True]


async def test_late_joiners_get_what_is_kept(sessions: tuple[RosSession, RosSession]) -> None:
    one, other = sessions
    outlet = RosOutlet(one, KEY, lambda: None, 2, waits=False)
    await until(lambda: outlet.is_wanted)
    for number in range(5):
        outlet.put(b"%d" % number, b"head")
    heard: list[bytes] = []
    other.hear(KEY, lambda payload, head: heard.append(payload), with_history=True)
    await until(lambda: heard == [b"3", b"4"])
    outlet.put(b"5", b"head")
    await until(lambda: heard == [b"3", b"4", b"5"])


async def test_a_long_attachment_counts_for_the_room_of_requests_that_wait(
    sessions: tuple[RosSession, RosSession],
) -> None:
    one, other = sessions
    sizes: list[int] = []

    class Source:
        def push(self, question: Question, size: int) -> None:
            sizes.append(size)
            question.drop()

    source: Any = Source()
    one.serve(KEY, source)
    asking = Asking(other, KEY)
    await until(lambda: asking.is_matched)
    ends: list[int] = []
    asking.ask(b"ask", bytes(100_000), lambda *answer: None, lambda: ends.append(1))
    await until(lambda: ends)
    assert len(sizes) == 1 and sizes[0] > 100_000


async def test_a_question_is_answered_or_ends(sessions: tuple[RosSession, RosSession]) -> None:
    one, other = sessions
    questions: list[Question] = []
    source = one.source(questions.append, 1 << 20, Question.drop, keeps_oldest=True)
    queryable = one.serve(KEY, source)
    asking = Asking(other, KEY)
    await until(lambda: asking.is_matched)
    answers: list[tuple[bytes, bytes, str, str]] = []
    ends: list[int] = []
    asking.ask(b"ask", b"1", lambda *answer: answers.append(answer), lambda: ends.append(1))
    await until(lambda: questions)
    assert questions[0][1:] == (b"ask", b"1")
    questions.pop().reply(KEY, b"answer", b"2")
    await until(lambda: ends)
    assert answers == [(b"answer", b"2", "", one.zenoh_id)]
    asking.ask(b"ask", b"", lambda *answer: answers.append(answer), lambda: ends.append(2))
    await until(lambda: questions)
    assert questions[0].attachment == b""
    questions.pop().drop()
    await until(lambda: ends == [1, 2])
    give_up = asking.ask(b"ask", b"", lambda *answer: answers.append(answer), lambda: ends.append(3))
    await until(lambda: questions)
    give_up()
    await until(lambda: ends == [1, 2, 3])
    assert len(answers) == 1
    questions.clear()
    asking.ask(b"ask", b"", lambda *answer: answers.append(answer), lambda: ends.append(4))
    await until(lambda: questions)
    questions[0].query.reply_err(b"bad\x1b[2J\xff" + 1000 * b"x")
    questions.pop().drop()
    await until(lambda: ends == [1, 2, 3, 4])
    assert answers[1][:3] == (b"", b"", "bad?[2J\ufffd" + 292 * "x")
    queryable.undeclare()
    await until(lambda: not asking.is_matched)


async def test_the_window_blocks_and_reports_room(
    sessions: tuple[RosSession, RosSession], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_WINDOW_BYTES", 10)
    sending = sessions[0].sending
    gate, room, done = threading.Event(), asyncio.Event(), []
    assert sending.add(gate.wait, 11, room.set)  # a long message has room when nothing waits
    assert not sending.add(lambda: done.append("blocked"), 1, room.set)
    assert sending.add(lambda: done.append("always"), 1)
    assert not room.is_set()
    gate.set()
    await room.wait()
    assert sending.add(lambda: done.append("later"), 1, room.set)
    await until(lambda: done == ["always", "later"])


async def test_a_failed_job_does_not_end_the_thread_that_sends(
    sessions: tuple[RosSession, RosSession],
) -> None:
    one = sessions[0]
    faults: list[Exception] = []
    one._on_fault = faults.append
    done: list[str] = []
    one.sending.add(lambda: 1 // 0, 1)
    one.sending.add(lambda: done.append("later"), 1)
    await until(lambda: done and faults)
    assert isinstance(faults[0], ZeroDivisionError)
