"""bus.delivery.receiver: queued messages, taking and counting them, and acknowledgements to a lossless
publisher.
"""

import builtins
from collections.abc import Callable
from typing import Any

import pytest

from bus import shm
from bus.delivery import allowance
from bus.delivery import receiver as inbox_module
from bus.delivery.receiver import Receiver
from bus.delivery.sequence import PublisherProxy
from bus.wire.runs import Run
from feeding import frame_record
from rows import for_each

FIRST, SECOND = 7, 8
"""Ids of two publishers."""
SECOND_NS = 1_000_000_000


class Box:
    """A receiver of numbers as text, and its calls."""

    def __init__(self, depth: int = 10, *, is_lossless: bool = False) -> None:
        self.dropped: list[tuple[str, int]] = []
        self.rejected: list[int] = []
        self.taken: list[tuple[int, int]] = []
        self.receiver: Receiver[int] = Receiver(
            lambda payload: int(bytes(payload)),
            depth,
            is_lossless=is_lossless,
            on_drop=lambda reason, count: self.dropped.append((reason, count)),
            on_reject=lambda size, error: self.rejected.append(size),
            on_taken=lambda source: self.taken.append((source.number, source.taken_seq)),
        )
        for number in (FIRST, SECOND):
            source = PublisherProxy(number, bytes([number]) * 16, 0, 0, needs_ack=is_lossless)
            self.receiver.tracker[number] = source

    def source(self, number: int = FIRST) -> PublisherProxy:
        return self.receiver.tracker[number]

    def put(self, first_seq: int, *payloads: str, source: int = FIRST, stamp_ns: int = 5) -> None:
        """Put a run, as the link does with the result of one read."""
        body = b"".join(frame_record(payload.encode(), stamp_ns) for payload in payloads)
        if self.receiver.put(Run(1, source, first_seq, len(payloads), body)):
            self.receiver.trim()

    def take(self, limit: int = 1) -> list[int]:
        """Take all queued messages."""
        found = []
        while taken := self.receiver.take(limit):
            found.append(taken[0])
        return found

    @property
    def counts(self) -> tuple[int, int, int, dict[str, int]]:
        return self.receiver.delivered, self.receiver.bytes, self.receiver.queued, self.receiver.dropped


def numbers(first: int, stop: int) -> list[str]:
    return [str(number) for number in range(first, stop)]


@for_each("limit", [1, 3, 64])
@for_each("depth", [0, 10])
def test_each_is_given_out_with_its_number_stamp_and_publisher(depth: int, limit: int) -> None:
    box = Box(depth)
    box.put(1, "11", "12", "13", stamp_ns=7)
    box.put(1, "21", source=SECOND, stamp_ns=8)
    box.put(4, "14", stamp_ns=9)
    got = []
    while taken := box.receiver.take(limit):
        message, stamp_ns, seq, source, _ = taken
        got.append((message, stamp_ns, seq, source.number))
    assert got == [(11, 7, 1, 7), (12, 7, 2, 7), (13, 7, 3, 7), (21, 8, 1, 8), (14, 9, 4, 7)]
    assert box.counts == (5, 10, 0, {})


class TestDepth:
    def test_the_oldest_are_replaced_and_counted_at_once(self) -> None:
        box = Box(3)
        box.put(1, *numbers(1, 6))
        assert (box.dropped, box.counts) == ([("replaced", 2)], (0, 0, 3, {"replaced": 2}))
        box.put(6, "6")
        assert box.take() == [4, 5, 6]
        assert box.counts == (3, 3, 0, {"replaced": 3})

    def test_the_most_missed_in_a_row(self) -> None:
        box = Box(3)
        box.put(1, *numbers(1, 5))
        box.put(5, *numbers(5, 7))
        assert box.receiver.most_missed == 3, "no message was taken in between"
        box.take()
        box.put(7, *numbers(7, 12))
        assert (box.receiver.most_missed, box.receiver.dropped) == (3, {"replaced": 5})
        box.put(12, *numbers(12, 20))
        assert box.receiver.most_missed == 10

    def test_what_was_not_decoded_yet_may_still_be_replaced(self) -> None:
        """So the receiver takes a run message by message, as long as newer messages can arrive in between."""
        box = Box(3)
        box.put(1, *numbers(1, 4))
        first = box.receiver.take()
        assert first is not None and first[0] == 1
        assert (box.receiver.delivered, box.receiver.queued) == (1, 2)
        box.put(4, *numbers(4, 6))
        assert box.take() == [3, 4, 5]
        assert box.dropped == [("replaced", 1)]

    def test_one_that_keeps_all_replaces_nothing(self) -> None:
        box = Box(0)
        box.put(1, *numbers(1, 100))
        box.put(100, *numbers(100, 200))
        assert box.receiver.queued == 199
        assert box.take() == [*range(1, 200)]

    def test_what_is_beyond_the_memory_goes_but_the_newest_stays(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(allowance, "STEP_BYTES", 1000)  # the bound of an empty queue
        monkeypatch.setattr(inbox_module, "INBOX_BYTES", 1000)
        box = Box(0, is_lossless=True)
        for seq in range(1, 11):
            box.put(seq, f"{seq:0500}")
        assert box.take() == [10]
        assert box.counts == (1, 500, 0, {"memory_limit": 9})
        assert box.taken[-2:] == [(FIRST, 9), (FIRST, 10)], "its publisher must not wait for what went"


class TestAcknowledging:
    def test_of_what_was_taken(self) -> None:
        box = Box(0, is_lossless=True)
        box.put(1, "1", "2", "3")
        assert box.taken == []
        box.receiver.take()
        assert box.taken == [(FIRST, 3)], "keep all decodes a run at once: none of it is ever replaced"
        assert box.source().unacked_bytes == 3
        box.put(4, "44")
        box.receiver.take()
        assert box.receiver.delivered == 2
        assert (box.taken[-1], box.source().unacked_bytes) == ((FIRST, 3), 3)
        box.take()
        assert (box.taken[-1], box.source().unacked_bytes) == ((FIRST, 4), 5)

    def test_of_each_publisher_by_itself(self) -> None:
        box = Box(0, is_lossless=True)
        box.put(1, "1")
        box.put(1, "2", "3", source=SECOND)
        box.take()
        assert box.taken == [(FIRST, 1), (SECOND, 2)]

    def test_of_what_has_expired(self) -> None:
        box = Box(0, is_lossless=True)
        box.source().lifespan_ns = 1
        box.put(1, "1", "2")
        assert box.take() == []
        assert (box.taken, box.dropped) == ([(FIRST, 2)], [("expired", 2)])

    def test_not_of_what_was_known(self) -> None:
        """A run may arrive again if its publisher does not know which messages were taken."""
        box = Box(0, is_lossless=True)
        box.put(1, *numbers(1, 5))
        box.take()
        box.put(2, *numbers(2, 7))
        box.put(1, *numbers(1, 4))
        assert box.take() == [5, 6]
        assert box.source().last_seq == 6
        assert [seq for _, seq in box.taken] == [4, 6]


def test_history_is_old_and_nothing_is_missing_behind_it() -> None:
    """History may arrive after newer messages that came by another route. It does not reset the known last
    number.
    """
    box = Box()
    box.source().last_seq = 9
    body = b"".join(frame_record(b"%d" % number, 5) for number in (7, 8))
    box.receiver.put(Run(1, FIRST, 7, 2, body, is_replay=True))
    box.put(9, "9", "10", "11")
    assert box.take() == [7, 8, 10, 11]
    assert (box.receiver.tracker.missing, box.receiver.tracker.repeated) == (0, 1)


class TestWhatIsWrong:
    def test_a_message_that_does_not_decode(self) -> None:
        box = Box()
        box.put(1, "1", "x", "3")
        box.put(4, "y")
        box.put(5, "5")
        assert box.take() == [1, 3, 5]
        assert (box.rejected, box.counts) == ([1, 1], (3, 3, 0, {"undecodable": 2}))

    @for_each("cut", [1, 5, 12, 14])
    @for_each("depth", [0, 10])
    def test_a_run_that_is_shorter_than_it_says(self, depth: int, cut: int) -> None:
        box = Box(depth)
        body = b"".join(frame_record(b"%d" % number, 5) for number in (1, 2, 3))
        box.receiver.put(Run(1, FIRST, 1, 3, body[:-cut]))
        box.put(4, "4")
        whole = 3 - (cut + 12) // 13
        assert box.take(3) == [*range(1, whole + 1), 4]
        assert box.dropped == [("undecodable", 3 - whole)]


def test_what_was_taken_in_advance_comes_first_and_counts_as_waiting() -> None:
    box = Box()
    box.receiver.put_back([1, 2])
    box.put(1, "3")
    assert box.receiver.queued == 3
    assert box.receiver.take_messages(10) == []
    assert box.take() == [1, 2, 3]


class _Rings:
    """Replaces the native reader; these messages wait in it."""

    overrun = expired = replaced = undecodable = samples = bytes = 0

    def __init__(self, source: PublisherProxy, *waiting: "tuple[int, builtins.bytes]") -> None:
        self.depth = 0
        self._source = source
        self._waiting = list(waiting)

    def waiting(self) -> int:
        return len(self._waiting)

    def messages(self, limit: int, decode: Any) -> list[Any]:
        return [message for message, *_ in self.take(limit, decode)]

    def take(self, limit: int, decode: Any) -> list[tuple[Any, int, int, PublisherProxy, int]]:
        batch, self._waiting = self._waiting[:limit], self._waiting[limit:]
        self.samples += len(batch)
        self.bytes += sum(len(payload) for _, payload in batch)
        return [(decode(payload), 5, seq, self._source, 6) for seq, payload in batch]


def take_by_one(receiver: Receiver[int]) -> list[int]:
    taken = receiver.take(64)
    return [] if taken is None else [taken[0]]


TAKES: list[Callable[[Receiver[int]], list[int]]] = [
    take_by_one,
    lambda receiver: receiver.take_messages(64),
    lambda receiver: [taken[0] for taken in receiver.take_many(64)],
]


class TestInterrupts:
    """KeyboardInterrupt in the decoder, at the message "3"; then the rest is taken."""

    def box(self, depth: int = 10) -> Box:
        box = Box(depth)
        left = [KeyboardInterrupt]

        def decode(payload: Any) -> int:
            if bytes(payload) == b"3" and left:
                raise left.pop()
            return int(bytes(payload))

        box.receiver._decode = decode
        return box

    def take(self, box: Box, take: Callable[[Receiver[int]], list[int]]) -> list[int]:
        found: list[int] = []
        with pytest.raises(KeyboardInterrupt):
            while True:
                found += take(box.receiver) or take_by_one(box.receiver)
        return found + box.take(64)

    @for_each("take", TAKES)
    @for_each("has_core", [True, False])
    def test_of_a_run(self, has_core: bool, take: Callable[[Receiver[int]], list[int]]) -> None:
        if has_core and not shm.has_core():
            return
        box = self.box()
        box.receiver.__dict__["_has_core"] = has_core
        box.put(1, "1", "2")
        box.put(3, "3", "4", "5")
        assert self.take(box, take) == [1, 2, 3, 4, 5]
        assert box.counts == (5, 5, 0, {})

    @for_each("take", TAKES)
    def test_of_a_single_message(self, take: Callable[[Receiver[int]], list[int]]) -> None:
        box = self.box()
        box.receiver.__dict__["_has_core"] = False
        for number in range(1, 6):
            box.put(number, str(number))
        assert self.take(box, take) == [1, 2, 4, 5]
        assert box.counts == (4, 4, 0, {"undecodable": 1})

    @pytest.mark.skipif(not shm.has_core(), reason="the native core is not there")
    @for_each("take", TAKES)
    def test_of_messages_in_a_ring(self, take: Callable[[Receiver[int]], list[int]]) -> None:
        from shm_ends import Listener, Talker

        talker, listener = Talker(), Listener()
        box = self.box()
        listener.join(talker, box.source())
        box.receiver.reader = listener.reader
        talker.write(*(str(number).encode() for number in range(1, 6)))
        assert self.take(box, take) == [1, 2, 4, 5]
        assert box.counts == (4, 4, 0, {"undecodable": 1})
        talker.close()
        listener.close()

    @pytest.mark.skipif(not shm.has_core(), reason="the native core is not there")
    @for_each("take", TAKES)
    def test_in_the_child_of_a_fork(self, take: Callable[[Receiver[int]], list[int]]) -> None:
        """The child has given up the reader when it leaves the decoder by SystemExit."""
        from shm_ends import Listener, Talker

        def decode(payload: Any) -> int:
            box.receiver.reader = None
            raise SystemExit

        talker, listener = Talker(), Listener()
        box = self.box()
        listener.join(talker, box.source())
        box.receiver.reader, box.receiver._decode = listener.reader, decode
        talker.write(b"1")
        with pytest.raises(SystemExit):
            take(box.receiver)
        talker.close()
        listener.close()

    @pytest.mark.skipif(not shm.has_core(), reason="the native core is not there")
    def test_of_a_message_alone(self) -> None:
        box = self.box()
        source = box.source()
        source.is_new = False
        found = []
        for number in range(1, 6):
            run = Run(1, FIRST, number, 1, frame_record(str(number).encode(), 5))
            try:
                taken = box.receiver.take_lone(run)
            except KeyboardInterrupt:
                continue
            assert taken is not None
            found.append(taken[0])
        assert found == [1, 2, 4, 5]
        assert box.counts == (4, 4, 0, {"undecodable": 1})
        assert source.last_seq == 5


class TestRings:
    def test_what_waits_there_is_brought_before_what_comes_by_socket(self) -> None:
        box = Box()
        box.receiver.reader = _Rings(box.source(), (1, b"1"), (2, b"22"))  # type: ignore[assignment]
        assert (box.receiver.queued, box.receiver.has_more) == (2, True)
        box.receiver.drain_rings()
        box.source().last_seq = 2  # the state after a subscription has left the ring
        box.put(3, "333")
        assert box.counts == (0, 0, 3, {})
        got = [(taken[0], taken[2]) for _ in range(3) if (taken := box.receiver.take())]
        assert got == [(1, 1), (22, 2), (333, 3)]
        assert box.counts == (3, 6, 0, {})

    def test_they_are_within_the_depth_too(self) -> None:
        box = Box()
        rings = box.receiver.reader = _Rings(box.source())  # type: ignore[assignment]
        box.receiver.set_depth(3)
        assert rings.depth == 3
        box.put(1, *numbers(1, 6))
        assert box.take() == [3, 4, 5]

    def test_what_a_ring_gave_up_unread_is_the_publishers_loss_where_all_is_kept(self) -> None:
        for depth, reason in ((0, "publisher_queue"), (5, "replaced")):
            box = Box(depth)
            rings = box.receiver.reader = _Rings(box.source())  # type: ignore[assignment]
            rings.overrun, rings.replaced, rings.expired = 2, 3, 4
            together = {"replaced": 3} | {reason: 2 + 3 * (reason == "replaced")}
            assert box.receiver.dropped == together | {"expired": 4}
