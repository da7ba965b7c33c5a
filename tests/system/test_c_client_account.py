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
from bus.wire.layout import DATA, DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES, REPLAY
from fake_broker import FakeBroker, FakeConnection
from programs import on_one_loop
from raw_peer import text
from semantics import KEEP_ALL

QOS, LATCHED = QoSProfile(10), QoSProfile(10, durability="transient_local")
SIZE = 4000
SUBSCRIPTION, TALKER, OTHER = 2, 7, 8


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


def match(connection: FakeConnection, next_seq: int, qos: QoSProfile = QOS, by: int = TALKER) -> None:
    gid = bytes([by]) * 16
    connection.send(
        m.Matched(endpoint=SUBSCRIPTION, other=by, node="/n", gid=gid, qos=qos, next_seq=next_seq)
    )


def send(connection: FakeConnection, *numbers: int, size: int = 0, by: int = TALKER, flags: int = 0) -> None:
    for number in numbers:
        body = text(f"{number} ".ljust(size))
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
        connection.write(DATA_HEAD.pack(length, DATA, flags, 0, SUBSCRIPTION, by, number, 1, 0) + body)


def report(connection: FakeConnection, dropped: dict[str, int], **more: object) -> None:
    connection.send(m.Dropped(subscription=SUBSCRIPTION, dropped=dropped, **more))  # type: ignore[arg-type]


def play_until_the_publisher_leaves(connection: FakeConnection) -> None:
    """Its last number is 10. busd has dropped samples 6 to 10."""
    match(connection, 1)
    send(connection, 1, 2, 3, 4, 5)
    report(connection, {"replaced": 5})
    connection.send(m.Unmatched(endpoint=SUBSCRIPTION, other=TALKER, last_seq=10))


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
            missed = {bytes([TALKER]) * 16: (first, end - 1)} if has_left else {}
            report(connection, {}, before=before, missed=missed)
            match(connection, end)
            send(connection, end)
            await listener.line(f"^{end} ")
            if end == first + 12:
                await connection.close()
        statistics = await listener.finish()
    assert {key: statistics[key] for key in fates} == fates
    assert (statistics["samples"], statistics["expected"]) == (5, 14)


@on_one_loop
async def test_drops_before_a_return_of_the_publisher_hide_no_later_loss(
    broker: FakeBroker, programs: Path, tmp_path: Path
) -> None:
    """The subscription is away from 12 to 16."""
    meeting = asyncio.create_task(meet(broker))
    async with c_programs.peer(programs, tmp_path, "listen", "/t") as listener:
        connection = await meeting
        play_until_the_publisher_leaves(connection)
        match(connection, 11)
        send(connection, 11)
        await listener.line("^11 ")
        await connection.close()
        connection = await meet(broker)
        report(connection, {}, before={"replaced": 5})
        match(connection, 17)
        send(connection, 17)
        await listener.line("^17 ")
        statistics = await listener.finish()
    assert (statistics["replaced"], statistics["lost"]) == (5, 5)
    assert (statistics["samples"], statistics["expected"]) == (7, 17)


@on_one_loop
async def test_drops_at_the_end_of_a_publisher_count_once(
    broker: FakeBroker, programs: Path, tmp_path: Path
) -> None:
    """busd reports it once more after the subscription's return."""
    meeting = asyncio.create_task(meet(broker))
    async with c_programs.peer(programs, tmp_path, "listen", "/t") as listener:
        connection = await meeting
        play_until_the_publisher_leaves(connection)
        await listener.line("^5 ")
        await connection.close()
        connection = await meet(broker)
        report(connection, {}, before={"replaced": 5}, missed={bytes([TALKER]) * 16: (1, 10)})
        match(connection, 1, by=OTHER)
        send(connection, 77, by=OTHER)
        await listener.line("^77 ")
        statistics = await listener.finish()
    assert (statistics["replaced"], statistics["lost"]) == (5, 0)


@on_one_loop
async def test_lossless_messages_stay_in_a_full_queue(
    broker: FakeBroker, programs: Path, tmp_path: Path
) -> None:
    """Above the bound, the oldest of the other messages are dropped, wherever they are in the queue."""
    most = c_programs.INBOX_BYTES // SIZE
    kept, count = most * 9 // 10, 2 * most
    meeting = asyncio.create_task(meet(broker))
    words = ("listen", "/t", "keep_all", "hold=1", f"late={kept + count}")
    async with c_programs.peer(programs, tmp_path, *words) as listener:
        connection = await meeting
        match(connection, 1, KEEP_ALL)
        match(connection, count + 1, by=OTHER)
        send(connection, *range(1, kept // 2), size=SIZE)
        for number in range(count + 1, 2 * count + 1):
            send(connection, number, size=SIZE, by=OTHER)
            if kept // 2 <= number - count <= kept:
                send(connection, number - count, size=SIZE)
        await listener.line(f"^{2 * count - 1} ")
        statistics = await listener.finish()
    others = [number for number in listener.numbers if number > count]
    assert [number for number in listener.numbers if number <= count] == [*range(1, kept + 1)]
    assert others == [*range(2 * count + 1 - len(others), 2 * count + 1)]
    assert 0 < len(others) <= most - kept
    assert statistics["lost"] == count - len(others)


@on_one_loop
@pytest.mark.parametrize("lacks", [0, 2], ids=["all of it", "a part of it"])
async def test_what_was_dropped_and_comes_again_with_the_history_counts_once(
    broker: FakeBroker, programs: Path, tmp_path: Path, lacks: int
) -> None:
    """busd has dropped 2 to 4; 5 and 6 were lost with the connection. The history begins with 2, or later."""
    meeting = asyncio.create_task(meet(broker))
    async with c_programs.peer(programs, tmp_path, "listen", "/t", "latched") as listener:
        connection = await meeting
        match(connection, 1, LATCHED)
        send(connection, 1)
        report(connection, {"replaced": 3})
        await listener.line("^1 ")
        await connection.close()
        connection = await meet(broker)
        match(connection, 7, LATCHED)
        send(connection, *range(2 + lacks, 7), flags=REPLAY)
        send(connection, 7)
        await listener.line("^7 ")
        statistics = await listener.finish()
    assert (statistics["replaced"], statistics["lost"]) == (lacks, 0)
    assert (statistics["samples"], statistics["expected"]) == (7 - lacks, 7)


@on_one_loop
@pytest.mark.parametrize("dropped", [0, 2])
async def test_what_a_history_lacks_counts_once(
    broker: FakeBroker, programs: Path, tmp_path: Path, dropped: int
) -> None:
    """Published while the subscription was away: 2 to 6. The history lacks a part, or busd drops it."""
    meeting = asyncio.create_task(meet(broker))
    async with c_programs.peer(programs, tmp_path, "listen", "/t", "latched") as listener:
        connection = await meeting
        match(connection, 1, LATCHED)
        send(connection, 1)
        await listener.line("^1 ")
        await connection.close()
        connection = await meet(broker)
        match(connection, 7, LATCHED)
        send(connection, 4, 5, 6, flags=REPLAY)
        if dropped:
            report(connection, {"replaced": dropped})
        send(connection, 7)
        await listener.line("^7 ")
        await connection.close()  # the counters are settled
        connection = await meet(broker)
        match(connection, 8, LATCHED)
        send(connection, 8)
        await listener.line("^8 ")
        statistics = await listener.finish()
    assert (statistics["replaced"], statistics["lost"]) == (dropped, 2 - dropped)
    assert (statistics["samples"], statistics["expected"]) == (6, 8)


@on_one_loop
async def test_the_end_of_a_publisher_whose_history_comes_again_is_no_loss(
    broker: FakeBroker, programs: Path, tmp_path: Path
) -> None:
    """A volatile subscription learned that the publisher has gone, and lost the samples before that."""
    meeting = asyncio.create_task(meet(broker))
    async with c_programs.peer(programs, tmp_path, "listen", "/t") as listener:
        connection = await meeting
        match(connection, 1, LATCHED)
        send(connection, 1)
        connection.send(m.Unmatched(endpoint=SUBSCRIPTION, other=TALKER, last_seq=3, lost=True))
        await listener.line("^1 ")
        await connection.close()
        connection = await meet(broker)
        match(connection, 1, LATCHED)
        send(connection, 2, 3)
        await listener.line("^3 ")
        statistics = await listener.finish()
    assert (statistics["samples"], statistics["expected"], statistics["lost"]) == (3, 3, 0)
