"""How much a queue of messages may hold in this process: its bound, or less where memory is short.

A queue that gets longer asks step by step. Where the memory cgroup or the machine has no more, it gives up
its oldest messages, as at its bound; else the kernel would kill the process. See `bus.shm.headroom`.
"""

from bus.shm.headroom import spare
from bus.wire.runs import RunQueue

QUEUE_BYTES = 64 << 20
"""The bound of a publisher's queue, and of what a lossless one keeps in case it must be sent again."""

STEP_BYTES = 4 << 20
_LEAST_SPARE_BYTES = 4 * STEP_BYTES  # besides what waits, there is what is being worked on


def begin(queue: RunQueue) -> None:
    """`queue` has been empty: others may have taken memory since it was long."""
    queue.account.limit = STEP_BYTES


def extend(queue: RunQueue, most_bytes: int, *, is_lossless: bool = False) -> None:
    """Where `queue` holds more than it may, let it hold more, up to `most_bytes`, if there is memory for it.

    One that `is_lossless` is bounded by its window, and gives up nothing before `most_bytes`.
    """
    account = queue.account
    if account.limit < min(account.used, most_bytes):
        if is_lossless:
            account.limit = most_bytes
        elif spare() >= _LEAST_SPARE_BYTES:
            account.limit = min(account.used + STEP_BYTES, most_bytes)
