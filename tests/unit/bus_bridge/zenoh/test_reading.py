"""The way in of a far publisher: kept messages, and answers about missing parts."""

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from bus.qos import QoSProfile
from bus_bridge.batch import Batch, Sample
from bus_bridge.engine import FarEndpoint
from bus_bridge.zenoh.presence import Interest
from bus_bridge.zenoh.records import PART_BYTES, Part, Room, pack, piece, probe, read_pair, write_pair
from bus_bridge.zenoh.window import History, Window
from rows import for_each

pytest.importorskip("zenoh", reason="needs the extra zenoh: make setup installs it")

from bus_bridge.zenoh.reading import ZenohReader

LARGE = 3 * PART_BYTES


class Question(NamedTuple):
    kind: bytes
    pair: tuple[int, int]
    on_answer: Callable[[bytes | None, bytes | None], None]


class Source:
    """Passes things on at once."""

    def __init__(self, take: Callable[[Any], None], after: Callable[[], None]) -> None:
        self._take, self._after = take, after

    def push(self, thing: Any, size: int) -> None:
        self._take(thing)
        self._after()

    def close(self) -> None: ...


class Declared:
    def undeclare(self) -> None: ...


class Scene:
    """A reader, and the far side that answers it by hand."""

    def __init__(self) -> None:
        self.questions: list[Question] = []
        self.samples: list[Sample] = []
        self.broken: list[str] = []
        session: Any = self
        endpoint = FarEndpoint("publisher", bytes(16), "n", "/t", "p/msg/T", "h", QoSProfile(10))
        own = Interest("here", "run")
        self.reader = ZenohReader(
            session, own, "far", endpoint, Room(1 << 20), self._see, self.broken.append, lambda: None
        )

    def source(self, take: Any, bound: int, lose: Any, *, keeps_oldest: bool, after: Any) -> Source:
        return Source(take, after)

    def subscribe(self, key: str, push: Any) -> Declared:
        self._push = push
        return Declared()

    def token(self, key: str) -> Declared:
        return Declared()

    def put(self, key: str, payload: bytes) -> None: ...

    def ask(self, key: str, payload: bytes, timeout_s: float, on_answer: Any) -> None:
        pair = read_pair(payload[1:])
        assert pair is not None
        self.questions.append(Question(payload[:1], pair, on_answer))

    def _see(self, batch: Batch) -> None:
        self.samples += batch

    @property
    def numbers(self) -> list[int]:
        return [one.number for one in self.samples]

    def come(self, *parts: Part) -> None:
        """Parts arrive that were put."""
        for part in parts:
            self._push("key", part.payload, part.head)

    def answer(self, part: Part | None, base: int | None = None) -> tuple[int, int]:
        """Answer the oldest question; returns its numbers. With `base` it asked for kept messages."""
        question = self.questions.pop(0)
        head = (b"" if base is None else write_pair(base, 0)) + (b"" if part is None else part.head)
        question.on_answer(b"" if part is None else part.payload, head)
        return question.pair

    def answer_from(self, history: History) -> None:
        """Answer the oldest question with kept messages, as another bridge does."""
        self.answer(history.find(*self.questions[0].pair, history.last), 0)


def sample(number: int, size: int = 1) -> Sample:
    return Sample(bytes(size), number, 0)


@for_each(
    ("sizes", "numbers"),
    [
        ((LARGE,), [3]),
        ((2 * LARGE,), [3]),
        ((PART_BYTES + 1,), [3]),
        ((1,), [3]),
        ((1, LARGE), [3, 4]),
    ],
)
def test_a_large_message_may_be_replaced_while_it_is_read(sizes: tuple[int, ...], numbers: list[int]) -> None:
    scene, history = Scene(), History(2)
    history.add([sample(1), sample(2, LARGE)])
    scene.answer_from(history)
    scene.answer_from(history)
    scene.answer_from(history)
    assert scene.questions[0].pair == (1, 2 * PART_BYTES) and scene.numbers == [1]
    history.limit(len(sizes))
    history.add([sample(number, size) for number, size in enumerate(sizes, 3)])
    while scene.questions:
        scene.answer_from(history)
    assert not scene.broken and scene.numbers == [1, *numbers]


def test_an_answer_that_helps_no_further_is_asked_for_once_more_and_not_for_ever() -> None:
    scene = Scene()
    part = piece(sample(1, LARGE), PART_BYTES, 0)
    scene.answer(piece(sample(2, LARGE), 0, 0), 0)
    assert scene.answer(part, 0) == (0, PART_BYTES)
    assert scene.answer(part, 0) == (0, 0)
    assert scene.broken == ["an answer about /t can't be read"] and not scene.questions


def test_a_kept_message_without_room_is_left_out() -> None:
    scene, history = Scene(), History(3)
    history.add([sample(1), sample(2, 2 << 20), sample(3, LARGE)])
    while scene.questions:
        scene.answer_from(history)
    assert not scene.broken and scene.numbers == [1, 3]


def part(number: int) -> Part:
    return pack([sample(number)], number)[0]


def test_parts_from_before_the_far_side_knew_this_bridge_are_not_asked_for_for_ever() -> None:
    scene, window = Scene(), Window(lossless=False)
    scene.answer(None, 0)
    for number in range(1, 11):
        if number == 8:
            window.join("run")
        window.add(part(number))
    scene.come(part(10))
    for _ in range(20):
        if scene.questions:
            after = scene.questions[0].pair[0]
            scene.answer(window.find("run", after) or probe(window.last))
    assert scene.numbers == [8, 9, 10] and not scene.questions
    scene.come(part(11))
    assert scene.numbers[-1] == 11


def test_an_answer_with_a_later_part_skips_no_part_that_is_on_its_way() -> None:
    scene = Scene()
    scene.answer(None, 0)
    scene.come(part(2), part(4))
    assert [one.pair[0] for one in scene.questions] == [0, 2]
    before = scene.questions.pop(0)
    assert scene.answer(part(4)) == (2, 0) and scene.numbers == []
    scene.questions.insert(0, before)
    scene.answer(part(1))
    assert scene.numbers == [1, 2]
    scene.answer(part(4))
    assert scene.numbers == [1, 2, 4]
