"""Requests for missing parts, and the times of their repetition."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from bus_bridge.batch import Loose, Sample
from bus_bridge.zenoh import missing
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.missing import Missing
from bus_bridge.zenoh.records import Room, read_pair
from semantics import until

Answer = Callable[[bytes | None, bytes | None], None]


class Scene:
    """Of the parts up to 100, only the last one has arrived."""

    def __init__(self) -> None:
        self.asked: dict[int, Answer] = {}
        """Requests without an answer, by the number of the part."""
        self.came: list[int] = []
        self.arrival = Arrival(Room(1 << 20))
        self.arrival.begin(0)
        self.arrival.arrive(100, self.content(100), 1)
        session: Any = self
        self.missing = Missing(session, "key", self.arrival, self._receive)

    def content(self, number: int) -> Loose:
        return Loose([Sample(b"x", number, 0)])

    def ask(self, key: str, payload: bytes, timeout_s: float, on_answer: Answer) -> None:
        found = read_pair(payload[1:])
        assert (key, payload[:1]) == ("key", b"p") and found is not None
        assert found[0] + 1 not in self.asked
        self.asked[found[0] + 1] = on_answer

    def _receive(self, number: int, payload: bytes, head: bytes | None) -> None:
        assert (payload, head) == (b"x", b"head")
        self.came.append(number)
        self.arrival.arrive(number, self.content(number), 1)
        self.missing.ask()

    def answer(self, number: int) -> None:
        self.asked.pop(number)(b"x", b"head")


def test_a_few_are_asked_for_at_first_and_more_while_answers_come() -> None:
    scene = Scene()
    scene.missing.ask()
    scene.missing.ask()
    assert [*scene.asked] == [1, 2, 3, 4]
    most = 0
    for number in range(1, 80):
        scene.answer(number)
        most = max(most, len(scene.asked))
    assert scene.came == [*range(1, 80)] and most == missing._MOST == 16


async def test_without_an_answer_one_is_asked_for_again_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missing, "AGAIN_S", 0.01)
    scene = Scene()
    scene.missing.ask()
    for number in (1, 2, 3, 4):
        scene.asked.pop(number)(None, None)
    await until(lambda: scene.asked)
    await asyncio.sleep(0.03)
    assert [*scene.asked] == [1]
    scene.answer(1)
    assert [*scene.asked] == [2, 3]


async def test_once_closed_it_takes_no_answer_and_asks_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missing, "AGAIN_S", 0.01)
    scene = Scene()
    scene.missing.ask()
    scene.asked.pop(1)(None, None)
    scene.missing.close()
    scene.answer(2)
    await asyncio.sleep(0.03)
    assert scene.came == [] and [*scene.asked] == [3, 4]
