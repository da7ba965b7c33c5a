"""bus.delivery.allowance: a queue fills up to its bound if memory is free; otherwise it keeps the newest
messages.
"""

import pytest

from bus.delivery import allowance
from bus.delivery.receiver import INBOX_BYTES, Receiver
from bus.wire.layout import RECORD_HEAD
from bus.wire.runs import Account, Run, RunQueue

MiB = 1 << 20
STEP = allowance.STEP_BYTES


@pytest.fixture
def left(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The first item is the free memory. Each look at it appends an item."""
    left = [1 << 40]

    def look() -> int:
        left.append(left[0])
        return left[0]

    monkeypatch.setattr(allowance, "spare", look)
    return left


def put(queue: RunQueue, seq: int, most: int = 64 * MiB, *, is_lossless: bool = False) -> int:
    """Append a message of 1 MiB, as a publisher does. Returns the number of old messages that the queue
    dropped.
    """
    if not queue.runs:
        allowance.begin(queue)
    queue.append(Run(0, 0, seq, 1, bytes(MiB)))
    allowance.extend(queue, most, is_lossless=is_lossless)
    return queue.drop_over_quota(spare=1)


def new_queue() -> RunQueue:
    return RunQueue(0, Account(STEP))


def test_up_to_its_bound_where_there_is_memory(left: list[int]) -> None:
    queue = new_queue()
    lost = sum(put(queue, seq) for seq in range(100))
    assert lost == 100 - 63  # each message costs slightly more than 1 MiB
    assert len(left) - 1 < 100 / (STEP / MiB) + 2  # one look for each step, and none beyond the bound


def test_no_longer_where_there_is_none(left: list[int]) -> None:
    queue = new_queue()
    assert not any(put(queue, seq) for seq in range(20))
    left[0] = 4 * STEP - 1
    lost = sum(put(queue, seq) for seq in range(20, 120))
    held = queue.count
    assert lost == 120 - held
    assert 20 <= held < 20 + STEP // MiB
    assert queue.runs[-1].first_seq == 119
    left[0] += 1
    put(queue, 120)
    assert queue.count == held + 1


def test_without_memory_a_little_is_held_and_always_the_newest(left: list[int]) -> None:
    left[0] = 0
    queue = new_queue()
    for seq in range(20):
        put(queue, seq)
    assert queue.count == STEP // MiB - 1
    queue = new_queue()
    queue.append(Run(0, 0, 1, 1, bytes(2 * STEP)))
    allowance.extend(queue, 64 * MiB)
    assert not queue.drop_over_quota(spare=1)


def test_one_that_was_empty_asks_anew(left: list[int]) -> None:
    queue = new_queue()
    for seq in range(40):
        put(queue, seq)
    queue.clear()
    left[0] = 0
    lost = sum(put(queue, seq) for seq in range(40, 80))
    assert lost > 30


def test_what_is_lossless_gives_up_nothing_before_its_bound(left: list[int]) -> None:
    left[0] = 0
    queue = new_queue()
    assert not any(put(queue, seq, is_lossless=True) for seq in range(63))
    assert put(queue, 63, is_lossless=True)
    assert left == [0]


@pytest.mark.parametrize(("spare", "held"), [(1 << 40, INBOX_BYTES // MiB - 1), (0, STEP // MiB - 1)])
def test_of_a_subscription(left: list[int], spare: int, held: int) -> None:
    """The subscription counts the messages that it drops."""
    left[0] = spare
    receiver: Receiver[bytes] = Receiver(
        bytes,
        0,
        is_lossless=False,
        on_drop=lambda *_: None,
        on_reject=lambda *_: None,
        on_taken=lambda *_: None,
    )
    body = RECORD_HEAD.pack(MiB, 1) + bytes(MiB)
    for seq in range(1, 301):
        if receiver.put(Run(0, 0, seq, 1, body)):
            receiver.trim()
    assert receiver.queued == held
    assert receiver.dropped == {"memory_limit": 300 - held}
