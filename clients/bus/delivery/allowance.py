"""The bound of a queue of messages in this process, or less if memory is short.

A queue that gets longer checks the free memory step by step. If the memory cgroup or the machine has no more,
it drops its oldest messages, as at its bound; otherwise the kernel would kill the process. See
`bus.shm.headroom`.
"""

from bus.shm.headroom import spare
from bus.wire.runs import RunQueue

QUEUE_BYTES = 64 << 20
"""The bound of a publisher's queue, and of the messages that a lossless publisher keeps for a resend."""

STEP_BYTES = 4 << 20
_LEAST_SPARE_BYTES = 4 * STEP_BYTES  # the program works on messages in addition to the queued ones


def begin(queue: RunQueue) -> None:
    """Reset the bound of an empty `queue`: other programs may have taken memory since it was long."""
    queue.account.limit = STEP_BYTES


def extend(queue: RunQueue, most_bytes: int, *, is_lossless: bool = False) -> None:
    """Raise the bound of a `queue` that is above it, up to `most_bytes`, if there is memory for it.

    `is_lossless`: its window bounds the queue, so nothing is dropped before `most_bytes`.
    """
    account = queue.account
    if account.limit < min(account.used, most_bytes):
        if is_lossless:
            account.limit = most_bytes
        elif spare() >= _LEAST_SPARE_BYTES:
            account.limit = min(account.used + STEP_BYTES, most_bytes)
