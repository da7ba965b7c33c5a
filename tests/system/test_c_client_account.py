"""The account of a subscription in C after lost connections: each sample counts once, and with its reason.

A scripted busd reports the drops.
"""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

import c_programs
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import DATA, DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES
from fake_broker import FakeBroker, FakeConnection
from programs import on_one_loop
from raw_peer import text

GID = b"the talker's gid"
SUBSCRIPTION, TALKER = 2, 7


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


@pytest.fixture
async def broker(socket_path: Path) -> AsyncIterator[FakeBroker]:
    async with FakeBroker(socket_path) as broker:
        yield broker


async def meet(broker: FakeBroker) -> FakeConnection:
    connection = await broker.accept()
    await connection.create(m.CreateNode, 1)
    await connection.create(m.CreateSubscription, SUBSCRIPTION)
    return connection


def match(connection: FakeConnection, next_seq: int) -> None:
    qos = QoSProfile(10)
    connection.send(
        m.Matched(endpoint=SUBSCRIPTION, other=TALKER, node="/n", gid=GID, qos=qos, next_seq=next_seq)
    )


def send(connection: FakeConnection, *numbers: int) -> None:
    for number in numbers:
        body = text(f"{number} ")
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
        connection.write(DATA_HEAD.pack(length, DATA, 0, 0, SUBSCRIPTION, TALKER, number, 1, 0) + body)


def report(connection: FakeConnection, dropped: dict[str, int], **more: object) -> None:
    connection.send(m.Dropped(subscription=SUBSCRIPTION, dropped=dropped, **more))  # type: ignore[arg-type]


# busd has dropped samples 3 and 4, and some of 6 to 12. Columns: the drops that it has reported before the
# loss of the connection, all drops until then, and the fates of these nine samples.
STORIES = [
    ({}, {}, {"replaced": 0, "expired": 0, "lost": 9}),
    ({"replaced": 5}, {}, {"replaced": 5, "expired": 0, "lost": 4}),
    ({"replaced": 5}, {"replaced": 5}, {"replaced": 5, "expired": 0, "lost": 4}),
    ({"replaced": 3}, {"replaced": 5}, {"replaced": 5, "expired": 0, "lost": 4}),
    ({"replaced": 3}, {"replaced": 3, "expired": 4}, {"replaced": 3, "expired": 4, "lost": 2}),
    ({}, {"replaced": 4}, {"replaced": 2, "expired": 0, "lost": 7}),
]


@on_one_loop
@pytest.mark.parametrize("story", range(len(STORIES)))
@pytest.mark.parametrize("first", [1, 101])
@pytest.mark.parametrize("has_left", [False, True])
async def test_each_sample_counts_once(
    broker: FakeBroker, programs: Path, tmp_path: Path, story: int, first: int, has_left: bool
) -> None:
    reported, before, fates = STORIES[story]
    meeting = asyncio.create_task(meet(broker))
    async with c_programs.peer(programs, tmp_path, "listen", "/t") as listener:
        connection = await meeting
        match(connection, first)
        send(connection, first, first + 1, first + 4)
        if reported:
            report(connection, reported)
        await listener.line(f"^{first + 4} ")
        await connection.close()
        for end in (first + 12, first + 13):
            connection = await meet(broker)
            missed = {GID: (first, end - 1)} if has_left else {}
            report(connection, {}, before=before, missed=missed)
            match(connection, end)
            send(connection, end)
            await listener.line(f"^{end} ")
            if end == first + 12:
                await connection.close()
        statistics = await listener.finish()
    assert {key: statistics[key] for key in fates} == fates
    assert (statistics["samples"], statistics["expected"]) == (5, 14)
