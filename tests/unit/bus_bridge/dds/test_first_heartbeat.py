"""Which readers ask for a heartbeat, and how often."""

import asyncio

import pytest

from bus_bridge.dds import first_heartbeat
from bus_bridge.dds.first_heartbeat import FirstHeartbeats
from bus_bridge.rtps.policies import TRANSIENT_LOCAL, VOLATILE, Policies
from semantics import until

READER, WRITER = b"r" * 16, b"w" * 16
PAUSES_S = (0.0, 0.001, 0.002)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(first_heartbeat, "_PAUSES_S", PAUSES_S)


async def test_several_questions() -> None:
    asked: list[tuple[bytes, bytes]] = []
    FirstHeartbeats(lambda *one: asked.append(one)).matched(READER, Policies(), WRITER)
    assert asked == []  # the reader's match is still being handled
    await until(lambda: len(asked) == len(PAUSES_S))
    assert set(asked) == {(READER, WRITER)}
    await asyncio.sleep(max(PAUSES_S) * 3)  # none comes that is too many
    assert len(asked) == len(PAUSES_S)


@pytest.mark.parametrize(
    ("reliable", "durability"), [(False, VOLATILE), (True, TRANSIENT_LOCAL), (False, TRANSIENT_LOCAL)]
)
async def test_readers_that_need_none(reliable: bool, durability: int) -> None:
    policies = Policies(reliable=reliable, durability=durability)
    asked: list[bytes] = []
    asking = FirstHeartbeats(lambda reader, writer: asked.append(reader))
    asking.matched(READER, policies, WRITER)
    asking.matched(WRITER, Policies(), WRITER)
    await until(lambda: len(asked) == len(PAUSES_S))
    assert set(asked) == {WRITER}
