"""bus.shm._core: a process that forks in a decoder or in a signal's handler. Its segment stays as it is."""

import os
import signal

import pytest

from shm_ends import LARGE, Listener, Talker, listener, talker

__all__ = ["listener", "talker"]

SEGMENT_BYTES = 1 << 20


@pytest.mark.parametrize("way", ["take", "deliver"])
def test_a_child_forked_in_a_decoder_leaves_the_slot_to_its_parent(talker: Talker, way: str) -> None:
    """The child has its own message, and takes no other."""
    listener = Listener(tells_cursor=True)
    listener.join(talker, start=1)
    talker.write(*(bytes(LARGE + number) for number in range(3)))
    statuses, sizes, slots = list[int](), list[int](), b""

    def fork(payload: memoryview) -> int:
        nonlocal slots
        if not slots:
            if child := os.fork():
                statuses.append(os.waitpid(child, 0)[1])
            else:
                listener.readers.close()
            slots = os.pread(listener.segment.number, SEGMENT_BYTES, 0)
        return len(payload)

    if way == "take":
        sizes = listener.reader.messages(9, fork)
    else:
        listener.reader.prepare(sizes.append, fork, list[Exception]().append, (), int)
        listener.readers.deliver(False)
    if not statuses:
        is_same = slots == os.pread(listener.segment.number, SEGMENT_BYTES, 0)
        os._exit(0 if is_same and sizes == [LARGE] else 1)
    assert statuses == [0]
    sizes += listener.reader.messages(9, len)
    assert sizes == [LARGE, LARGE + 1, LARGE + 2]
    listener.close()


def test_a_child_forked_by_a_signal_leaves_the_bell_to_its_parent(listener: Listener) -> None:
    statuses, bell = list[int](), b""

    def fork(*_: object) -> None:
        nonlocal bell
        if child := os.fork():
            statuses.append(os.waitpid(child, 0)[1])
        else:
            listener.readers.close()
            bell = os.pread(listener.segment.number, SEGMENT_BYTES, 0)

    handler = signal.signal(signal.SIGALRM, fork)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        while not statuses and not bell:
            listener.readers.sleep(10_000_000)
    finally:
        if not statuses:
            os._exit(0 if bell == os.pread(listener.segment.number, SEGMENT_BYTES, 0) else 1)
        signal.signal(signal.SIGALRM, handler)
    assert statuses == [0]
