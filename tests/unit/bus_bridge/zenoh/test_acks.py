"""Acknowledgements: when the bridge of a far publisher learns this bridge's position."""

import asyncio
from typing import Any

import pytest

from bus_bridge.batch import Loose, Sample
from bus_bridge.zenoh import acks
from bus_bridge.zenoh.acks import Acks
from bus_bridge.zenoh.arrival import Arrival
from bus_bridge.zenoh.records import Room, read_pair
from semantics import until


class Scene:
    """Four parts of 100 bytes have arrived."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, int] | None] = []
        self.arrival = Arrival(Room(1 << 20))
        self.arrival.begin(0)
        session: Any = self
        self.acks = Acks(session, "key", self.arrival)
        for number in range(1, 5):
            self.arrival.arrive(number, Loose([Sample(bytes(100), number, 0)]), 100)
            self.acks.arrived(number, 100)

    def put(self, key: str, payload: bytes) -> None:
        assert key == "key"
        self.sent.append(read_pair(payload))


async def test_an_ack_says_what_has_arrived_and_what_was_taken() -> None:
    scene = Scene()
    scene.acks.send()
    scene.acks.taken(250)
    scene.acks.send()
    assert scene.sent == [(4, 0), (4, 2)]


async def test_what_is_taken_is_told_a_moment_later_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(acks, "_PAUSE_S", 0.01)
    scene = Scene()
    scene.acks.taken(100)
    scene.acks.taken(100)
    assert scene.sent == []
    await until(lambda: scene.sent)
    await asyncio.sleep(0.03)
    assert scene.sent == [(4, 2)]


async def test_after_many_bytes_it_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(acks, "_BYTES", 300)
    monkeypatch.setattr(acks, "_PAUSE_S", 0.01)
    scene = Scene()
    for sent in ([], [], [(4, 3)], [(4, 3)]):
        scene.acks.taken(100)
        assert scene.sent == sent
    scene.acks.close()
    await asyncio.sleep(0.03)
    assert scene.sent == [(4, 3)]


async def test_an_ack_answers_what_was_asked() -> None:
    scene = Scene()
    scene.acks.is_due = True
    scene.acks.send()
    assert not scene.acks.is_due
