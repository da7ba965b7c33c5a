"""The layers of the wire: frames, session, runs and their queues, the outbox. Must not know the broker."""

from collections import deque
from contextlib import suppress
from typing import Any
from unittest.mock import patch

import msgspec

from bus.delivery.receiver import Receiver
from bus.delivery.sequence import PublisherProxy
from bus.errors import RemoteProtocolError
from bus.wire import framing
from bus.wire import messages as m
from bus.wire.framing import FrameReader
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    LENGTH_BYTES,
    MAX_COUNT,
)
from bus.wire.outbox import MAX_BUFFERS, TAKE_BYTES, Outbox
from bus.wire.runs import Account, Run, RunQueue
from bus.wire.session import Carried, Role, Session, State
from feeding import feed
from fuzz.script import Script

_SMALL_BUFFER = 128
"""In place of 256 KiB: short inputs then have frames that are too long for it."""
_MOST_CONTROL, _MOST_DATA = 300, 500


class Brought:
    """A replacement for a descriptor."""

    def __init__(self) -> None:
        self.is_closed = False

    def close(self) -> None:
        assert not self.is_closed, "closed twice"
        self.is_closed = True


def frames(data: bytes) -> None:
    """A stream cut anywhere gives the same frames, and the same end, as a plain decoder of the whole."""
    script = Script(data)
    pieces = [1 + script.byte() for _ in range(script.byte() % 16)]
    stream = script.rest()
    small: dict[str, Any] = {"BUFFER_BYTES": _SMALL_BUFFER, "_FIRST_ROOM_BYTES": 2 * _SMALL_BUFFER}
    with patch.multiple(framing, **small):
        reader = FrameReader(max_control_bytes=_MOST_CONTROL, max_data_bytes=_MOST_DATA)
        found: list[Any] = []
        with suppress(RemoteProtocolError):
            for item in feed(reader, stream, pieces):
                found.append(item)
        room = len(reader.get_buffer()) if reader.fault is None else 1
    expected, is_broken = _decode_plainly(stream)
    assert list(map(_shown, found)) == expected
    assert (reader.fault is not None) == is_broken
    assert 0 < room <= max(_SMALL_BUFFER, 2 * len(stream), DATA_HEAD_BYTES + _MOST_DATA)


def _decode_plainly(stream: bytes) -> tuple[list[Any], bool]:
    found: list[Any] = []
    at = 0
    while len(stream) - at >= FRAME_HEAD_BYTES:
        length, kind, flags, zero = FRAME_HEAD.unpack_from(stream, at)
        if kind == CONTROL:
            least, most, known = FRAME_HEAD_BYTES, FRAME_HEAD_BYTES + _MOST_CONTROL, 0
        elif kind == DATA:
            least, most, known = DATA_HEAD_BYTES, DATA_HEAD_BYTES + _MOST_DATA, 3
        else:
            return found, True
        stop = at + LENGTH_BYTES + length
        if zero or flags > known or not least <= stop - at <= most:
            return found, True
        if stop > len(stream):
            break
        if kind == CONTROL:
            found.append(stream[at + FRAME_HEAD_BYTES : stop])
        else:
            _, _, _, _, endpoint, source, first_seq, count, zero = DATA_HEAD.unpack_from(stream, at)
            if zero or not count or first_seq + count - 1 > MAX_COUNT:
                return found, True
            body = stream[at + DATA_HEAD_BYTES : stop]
            found.append((endpoint, source, first_seq, count, body, bool(flags & 1), bool(flags & 2)))
        at = stop
    return found, False


def _shown(item: Any) -> Any:
    if not isinstance(item, Run):
        return item
    head = item.endpoint, item.source or item.only_for, item.first_seq, item.count
    return *head, bytes(item.body), item.is_replay, item.is_resumed


def session(data: bytes) -> None:
    """Either end, with any input: one RemoteProtocolError, and then nothing more; no descriptor is lost."""
    script = Script(data)
    how = script.byte()
    receiver = Session(Role.CLIENT if how & 1 else Role.BROKER, max_message_bytes=1 << 20)
    pieces = [1 + script.byte() for _ in range(how >> 1 & 7)]
    brought: list[Brought] = []
    for _ in range(how >> 4):
        batch = tuple(Brought() for _ in range(script.byte() % 4))
        brought += batch
        receiver.descriptors.append(batch)  # type: ignore[arg-type]
    carried: list[Brought] = []
    try:
        for at, item in enumerate(feed(receiver, script.rest(), pieces)):
            if isinstance(item, Carried):
                carried += item.descriptors  # type: ignore[arg-type]
                assert len(item.descriptors) in (0, item.message.descriptors)  # type: ignore[attr-defined]
                item = item.message
            if isinstance(item, Run):
                assert sum(1 for _ in item.records()) <= item.count
            else:
                _check_round_trip(item, receiver)
            assert receiver.peer is not None
            assert at > 0 or isinstance(item, m.Hello), "the Hello is first"
        assert receiver.state is not State.CLOSED
    except RemoteProtocolError:
        assert receiver.state is State.CLOSED
    receiver.drop_descriptors()
    assert all(one.is_closed != (one in carried) for one in brought)


def _check_round_trip(message: m.Message, receiver: Session) -> None:
    decode = m.from_client.decode if receiver._decode == m.from_client.decode else m.from_broker.decode
    again = decode(m.encode_frame(message)[FRAME_HEAD_BYTES:])
    assert msgspec.msgpack.encode(again) == msgspec.msgpack.encode(message)


def runs(data: bytes) -> None:
    """A queue of runs that are shorter than announced, or worse: its counts stay right, its end is empty."""
    script = Script(data)
    account = Account(script.byte() * 8)
    queue = RunQueue(script.byte() % 8, account, endpoint=3)
    seq = 1
    while script:
        match script.byte() % 8:
            case 0 | 1 | 2:
                run = _next_run(script, seq)
                seq = run.first_seq + run.count
                queue.append(run)
            case 3:
                before = queue.count
                assert queue.trim() == before - queue.count
            case 4:
                asked, before = script.byte(), queue.count
                assert queue.drop(asked) == min(asked, before) == before - queue.count
            case 5:
                spare = script.byte() % 2
                queue.drop_over_quota([], spare=spare)
                assert account.used <= account.limit or len(queue.runs) <= spare
            case 6:
                queue.drop_expired(script.number())
            case _:
                if queue.runs:
                    _check_frame(queue)
        for run in queue.newest(script.byte() % 4, seq - script.byte() % 16):
            assert run.count > 0
            assert sum(1 for _ in run.records()) <= run.count
        assert account.used == queue.held_bytes >= 0
        assert queue.count == sum(run.count for run in queue.runs) - queue.skipped >= 0
        assert queue.bound >= queue.depth
    queue.clear()
    assert (queue.count, queue.held_bytes, account.used, len(queue.runs)) == (0, 0, 0, 0)


def _next_run(script: Script, seq: int) -> Run:
    count = 1 + script.byte() % 5
    how = script.byte()
    body = script.take(script.byte() % 64)
    run = Run(
        1, how & 3, seq + (how >> 2 & 1), count, body, is_replay=bool(how & 8), is_resumed=bool(how & 16)
    )
    run.lifespan_ns = 10 if how & 32 else 0
    return run


def _check_frame(queue: RunQueue) -> None:
    expected = queue.runs[0].count - queue.skipped
    first_seq = queue.runs[0].first_seq + queue.skipped
    frame = b"".join(queue.pop_frame())
    reader = FrameReader(max_control_bytes=0, max_data_bytes=len(frame))
    (run,) = feed(reader, frame)
    assert (run.endpoint, run.count, run.first_seq) == (3, expected, first_seq)


def receiver(data: bytes) -> None:
    """For any input, samples to a subscription are delivered, or dropped for one reason, or wait."""
    script = Script(data)
    depth = script.byte() % 8
    dropped: dict[str, int] = {}

    def on_drop(reason: str, count: int) -> None:
        assert count > 0
        dropped[reason] = dropped.get(reason, 0) + count

    box: Receiver[Any] = Receiver(
        msgspec.msgpack.Decoder(str | int | None).decode,
        depth,
        is_lossless=bool(script.byte() & 1),
        on_drop=on_drop,
        on_reject=lambda size, error: None,
        on_taken=lambda source: None,
    )
    for number in (1, 2):
        box.tracker[number] = PublisherProxy(number, bytes([number]), 0, 0, needs_ack=True)
    put, seq = 0, 1
    while script:
        match script.byte() % 6:
            case 0 | 1 | 2:
                run = _next_run(script, seq)
                seq = max(1, run.first_seq + run.count - script.byte() % 2)
                before = box.queued
                is_overfull = box.put(run)
                put += box.queued - before
                if is_overfull:
                    box.trim()
            case 3:
                box.take(1 + script.byte() % 4)
            case 4:
                box.trim()
            case _:
                box.tracker.forget(1 + script.byte() % 2)
        assert put == box.tracker.received == box.delivered + box.queued + sum(dropped.values())
    box.trim()
    while box.has_more:
        box.take(1 << 30)
    assert put == box.delivered + sum(dropped.values())
    assert box.dropped == dropped


def outbox(data: bytes) -> None:
    """Control frames go out in order and before the samples; each descriptor with its frame, alone."""
    script = Script(data)
    box, account = Outbox(), Account(1 << 30)
    queues = [RunQueue(0, account, endpoint=number) for number in range(3)]
    control: deque[tuple[bytes, tuple[Any, ...]]] = deque()
    seqs = [1, 1, 1]
    sent = [0, 0, 0]
    while script or box:
        act = script.byte() % 8 if script else 7
        if act < 3:
            frame = bytes([255]) * (1 + script.byte() * (300 if act == 2 else 1))
            carried = (Brought(),) * (act == 1)
            control.append((frame, carried))
            box.put(frame, carried)  # type: ignore[arg-type]
        elif act < 6:
            at = script.byte() % 3
            body = bytes(12 + script.byte() * 8 * (act - 3))
            queues[at].append(Run(0, 1, seqs[at], 1, body))
            seqs[at] += 1
            box.make_ready(queues[at])
        else:
            _check_taken(box, control, sent)
        assert box.account.used == sum(len(frame) for frame, _ in control)
        assert bool(box) == (bool(control) or any(queue.runs for queue in queues))
    assert [number + 1 for number in sent] == seqs
    assert account.used == 0
    assert not any(queue.is_ready for queue in queues)


def _check_taken(box: Outbox, control: deque[tuple[bytes, tuple[Any, ...]]], sent: list[int]) -> None:
    buffers, size, carried = box.take()
    assert sum(map(len, buffers)) == size
    assert len(buffers) <= MAX_BUFFERS + 1
    assert size <= TAKE_BYTES + 255 * 300, "one frame more than it should be at most"
    while buffers and buffers[0][:1] == b"\xff":
        assert (buffers.pop(0), carried) == control.popleft()
        assert not (carried and buffers), "a frame with descriptors leaves alone"
    assert not (control and buffers), "samples before control frames"
    for head, body in zip(buffers[::2], buffers[1::2], strict=True):
        _, kind, _, _, endpoint, _, seq, count, _ = DATA_HEAD.unpack(head)
        assert (kind, count) == (DATA, 1)
        assert len(body) >= 12
        assert seq == sent[endpoint] + 1, "samples out of order"
        sent[endpoint] = seq
