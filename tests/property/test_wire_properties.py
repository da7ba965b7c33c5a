"""The wire against naive models: a queue of runs, damaged streams, and messages encoded and decoded."""

from typing import Any

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from bus.base.descriptor import Descriptor
from bus.errors import RemoteProtocolError
from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES, PROTOCOL_VERSION, REPLAY, RESUMED
from bus.wire.runs import RUN_COST_BYTES, Account, Run, RunQueue
from bus.wire.session import Carried, Role, Session, State
from effort import examples
from feeding import feed, frame_record


class Sample:
    """One sample of the model; `is_good` is False if the body is too short for it."""

    def __init__(self, seq: int, payload: bytes, stamp_ns: int, *, is_good: bool = True) -> None:
        self.seq = seq
        self.payload = payload
        self.stamp_ns = stamp_ns
        self.is_good = is_good


class ModelRun:
    """A list of samples, and the size of the body that carries them."""

    def __init__(self, samples: list[Sample], size: int, lifespan_ns: int, flags: int) -> None:
        self.samples = samples
        self.size = size
        self.lifespan_ns = lifespan_ns
        self.flags = flags


class QueueAgainstModel(RuleBasedStateMachine):
    """A RunQueue behaves as a list of samples that is checked one by one."""

    def __init__(self) -> None:
        super().__init__()
        self.depth = 0
        self.account = Account(200 + 3 * RUN_COST_BYTES)
        self.queue = RunQueue(0, self.account, endpoint=3)
        self.runs: list[ModelRun] = []
        self.room_for_replays = 0
        self.others = 0
        self.next_seq = 1

    def samples(self) -> list[Sample]:
        return [sample for run in self.runs for sample in run.samples]

    def settle(self) -> None:
        """Remove used runs, with their bytes."""
        self.runs = [run for run in self.runs if run.samples]
        if not self.runs:
            self.room_for_replays = 0

    def drop(self, count: int) -> int:
        dropped = 0
        while dropped < count and self.runs:
            self.runs[0].samples.pop(0)
            dropped += 1
            self.settle()
        return dropped

    def is_over_depth(self) -> bool:
        return self.depth > 0 and len(self.samples()) > self.depth + self.room_for_replays

    @rule(
        payloads=st.lists(st.binary(max_size=6), min_size=1, max_size=5),
        gap=st.integers(0, 2),
        stamp_ns=st.integers(0, 20),
        lifespan_ns=st.sampled_from([0, 5, 10]),
        is_replay=st.booleans(),
        is_resumed=st.booleans(),
        missing=st.integers(0, 3),
        tail=st.sampled_from([b"", b"\1\2", b"\xff" * 12, b"\xff" * 20]),
    )
    def append(
        self,
        payloads: list[bytes],
        gap: int,
        stamp_ns: int,
        lifespan_ns: int,
        is_replay: bool,
        is_resumed: bool,
        missing: int,
        tail: bytes,
    ) -> None:
        first = self.next_seq + gap
        samples = [Sample(first + at, payload, stamp_ns + at) for at, payload in enumerate(payloads)]
        body = b"".join(frame_record(sample.payload, sample.stamp_ns) for sample in samples)
        if missing:
            samples += [Sample(first + len(payloads) + at, b"", 0, is_good=False) for at in range(missing)]
            body += tail
        self.next_seq = first + len(samples)
        run = Run(0, 8, first, len(samples), body, is_replay, lifespan_ns, is_resumed=is_resumed)
        flags = REPLAY * is_replay | RESUMED * is_resumed
        self.runs.append(ModelRun(samples, len(body) + RUN_COST_BYTES, lifespan_ns, flags))
        if is_replay:
            self.room_for_replays += len(samples)
        over_quota = sum(run.size for run in self.runs) + self.others > self.account.limit
        assert self.queue.append(run) == (self.is_over_depth() or over_quota)

    @rule(depth=st.integers(0, 8))
    def change_depth(self, depth: int) -> None:
        self.depth = depth
        self.queue.set_depth(depth)

    @rule(size=st.integers(0, 150))
    def others_hold(self, size: int) -> None:
        self.account.used += size - self.others
        self.others = size

    @rule()
    def trim(self) -> None:
        excess = len(self.samples()) - self.depth - self.room_for_replays if self.is_over_depth() else 0
        assert self.queue.trim() == self.drop(excess)

    @rule(count=st.integers(0, 12))
    def drop_some(self, count: int) -> None:
        assert self.queue.drop(count) == self.drop(count)

    @rule()
    def clear(self) -> None:
        assert self.queue.clear() == self.drop(len(self.samples()))

    @rule(spare=st.integers(0, 2))
    def drop_over_quota(self, spare: int) -> None:
        dropped = 0
        while (
            len(self.runs) > spare and sum(run.size for run in self.runs) + self.others > self.account.limit
        ):
            dropped += self.drop(len(self.runs[0].samples))
        assert self.queue.drop_over_quota(spare=spare) == dropped

    @rule(now_ns=st.integers(0, 40))
    def drop_expired(self, now_ns: int) -> None:
        dropped = 0
        while self.runs and self.runs[0].lifespan_ns:
            head = self.runs[0].samples[0]
            # Unreadable samples may or may not look expired; here the model follows the queue.
            if not head.is_good or head.stamp_ns + self.runs[0].lifespan_ns >= now_ns:
                break
            dropped += self.drop(1)
        found = self.queue.drop_expired(now_ns)
        assert found >= dropped
        if found > dropped:
            assert not self.runs[0].samples[0].is_good
            self.drop(found - dropped)

    @precondition(lambda self: self.runs)
    @rule()
    def pop_frame(self) -> None:
        run = self.runs.pop(0)
        head, body = self.queue.pop_frame()
        length, _, flags, _, endpoint, source, first_seq, count, _ = DATA_HEAD.unpack(head)
        assert length == len(head) - LENGTH_BYTES + len(body)
        assert (endpoint, source, flags) == (3, 8, run.flags)
        assert (first_seq, count) == (run.samples[0].seq, len(run.samples))
        self.check_payloads(Run(endpoint, source, first_seq, count, body), run.samples)
        self.settle()

    @precondition(lambda self: self.runs and self.runs[0].samples[0].is_good)
    @rule()
    def use_one(self) -> None:
        sample = self.runs[0].samples.pop(0)
        self.queue.advance(1, self.queue.offset + len(frame_record(sample.payload, 0)))
        self.settle()

    @rule(count=st.integers(0, 8), after=st.integers(-3, 8))
    def newest(self, count: int, after: int) -> None:
        samples = self.samples()
        after_seq = (samples[0].seq if samples else 1) + after
        expected = {one.seq: one for one in (samples[-count:] if count else samples) if one.seq > after_seq}
        seen: list[int] = []
        for run in self.queue.newest(count, after_seq):
            numbers = list(range(run.first_seq, run.first_seq + run.count))
            self.check_payloads(run, [expected[number] for number in numbers])
            assert run.is_replay
            assert not run.is_resumed
            seen += numbers
        assert seen == list(expected)

    def check_payloads(self, run: Run, samples: list[Sample]) -> None:
        good = [(one.payload, one.stamp_ns) for one in samples if one.is_good]
        found = [(bytes(payload), stamp_ns) for payload, stamp_ns in run.records()]
        assert found == good if all(one.is_good for one in samples) else found[: len(good)] == good

    @invariant()
    def counts_agree(self) -> None:
        assert self.queue.count == len(self.samples())
        assert self.queue.held_bytes == sum(run.size for run in self.runs)
        assert self.account.used == self.queue.held_bytes + self.others
        if self.queue.depth:
            assert self.queue.bound == self.queue.depth + self.room_for_replays
        assert bool(self.queue.runs) == bool(self.runs)


TestQueueAgainstModel = QueueAgainstModel.TestCase
TestQueueAgainstModel.settings = settings(max_examples=examples(100), stateful_step_count=40, deadline=None)


# --- damaged streams

names = st.text(max_size=8)
control_messages = st.one_of(
    st.builds(m.Ping, number=st.integers(0, 2**40)),
    st.builds(m.CreateNode, request=st.integers(0, 99), name=names, namespace=names),
    st.builds(m.DeclareType, type_name=names, type_hash=names, schema=st.just(b"\x81\xa1a\x01")),
    st.builds(
        m.CreateSubscription,
        request=st.integers(0, 99),
        node=st.integers(-1, 99),
        topic=names,
        type_name=names,
        type_hash=names,
        qos=st.builds(
            QoSProfile, depth=st.integers(1, 9), history=st.sampled_from(["keep_all", "keep_last"])
        ),
        gid=st.binary(max_size=16),
        last_seqs=st.dictionaries(st.binary(max_size=16), st.integers(0, 2**40), max_size=3),
    ),
    st.builds(m.Ack, subscription=st.integers(0, 9), source=st.integers(0, 9), seq=st.integers(0, 2**40)),
    st.builds(
        m.Report,
        endpoint=st.integers(0, 9),
        samples=st.integers(0, 99),
        bytes=st.integers(0, 99),
        dropped=st.dictionaries(st.text(max_size=8), st.integers(0, 99), max_size=3),
    ),
)


def data_frame(first_seq: int, payloads: list[bytes]) -> bytes:
    body = b"".join(frame_record(payload, 1) for payload in payloads)
    length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
    return DATA_HEAD.pack(length, 2, 0, 0, 1, 0, first_seq, len(payloads), 0) + body


frames = st.one_of(
    control_messages.map(m.encode_frame),
    st.builds(data_frame, st.integers(1, 2**40), st.lists(st.binary(max_size=9), min_size=1, max_size=4)),
)
pieces = st.lists(st.integers(1, 40), max_size=20)


def open_session() -> Session:
    session = Session(Role.BROKER)
    list(feed(session, m.encode_frame(m.Hello(version=PROTOCOL_VERSION))))
    return session


def shown(item: Any) -> Any:
    if isinstance(item, Run):
        return item.endpoint, item.first_seq, item.count, bytes(item.body)
    return msgspec.msgpack.encode(item)


@settings(deadline=None)
@given(st.lists(control_messages, max_size=5), pieces)
def test_messages_come_out_as_they_went_in(sent: list[m.Message], sizes: list[int]) -> None:
    stream = b"".join(map(m.encode_frame, sent))
    assert [shown(one) for one in feed(open_session(), stream, sizes)] == [shown(one) for one in sent]


carriers = st.one_of(
    st.just(m.Share()),
    st.builds(m.ReplaceRing, publisher=st.integers(0, 9)),
    st.builds(m.ReplaceRing, publisher=st.integers(0, 9), descriptors=st.integers(0, 2)),
)


@settings(deadline=None)
@given(st.lists(st.tuples(st.one_of(carriers, control_messages), st.booleans()), max_size=8), pieces)
def test_descriptors_find_their_messages(sent: list[tuple[m.Message, bool]], sizes: list[int]) -> None:
    """Read as the kernel delivers: a read ends with the piece of a frame that carries descriptors.

    Some batches of descriptors are lost in transit, and arrive empty.
    """
    session = open_session()
    found: list[Any] = []
    waiting: list[Any] = []
    expected: list[Any] = []
    for message, is_cut in sent:
        claimed = getattr(message, "descriptors", 0)
        batch = tuple(Descriptor(-2) for _ in range(0 if is_cut else claimed))
        waiting.append((m.encode_frame(message), batch if claimed else None))
        expected.append(Carried(message, batch) if claimed else message)
    room = iter(sizes)
    while waiting:
        left, read = next(room, 1 << 20), b""
        while left and waiting:
            frame, arriving = waiting.pop(0)
            read += frame[:left]
            if frame[left:]:
                waiting.insert(0, (frame[left:], None))
            left -= min(left, len(frame))
            if arriving is not None:
                session.descriptors.append(arriving)
                break
        found += feed(session, read)
    assert [_with_numbers(item) for item in found] == [_with_numbers(item) for item in expected]
    assert not session.descriptors


def _with_numbers(item: Any) -> Any:
    return (shown(item.message), *map(id, item.descriptors)) if isinstance(item, Carried) else shown(item)


@settings(deadline=None)
@given(st.lists(frames, min_size=1, max_size=5), pieces, st.data())
def test_damage_is_refused_or_harmless(stream: list[bytes], sizes: list[int], data: st.DataObject) -> None:
    """A byte changed, removed or inserted: RemoteProtocolError at most, and earlier frames stay correct."""
    good = b"".join(stream)
    at = data.draw(st.integers(0, len(good) - 1))
    new = data.draw(st.binary(max_size=3))
    damaged = good[:at] + new + good[at + data.draw(st.integers(0, 3)) :]
    intact = 0
    while intact < len(stream) and sum(map(len, stream[: intact + 1])) <= at:
        intact += 1
    session, found = open_session(), []
    try:
        for item in feed(session, damaged, sizes):
            found.append(shown(item))
    except RemoteProtocolError:
        assert session.state is State.CLOSED
    else:
        assert session.state is State.OPEN
    before = [shown(item) for item in feed(open_session(), b"".join(stream[:intact]))]
    assert found[:intact] == before


@settings(deadline=None)
@given(st.binary(max_size=100))
def test_any_control_body_is_understood_or_refused(body: bytes) -> None:
    for decoder in (m.from_client, m.from_broker):
        try:
            message = decoder.decode(body)
        except RemoteProtocolError:
            continue
        assert isinstance(message, m.Message)
