"""Publishers and subscriptions of the processes of `broker_world`, from the view of these processes."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from bus.base.ids import EndpointId
from bus.wire import messages as m
from bus.wire.layout import DATA, DATA_HEAD, DATA_HEAD_BYTES, LENGTH_BYTES, REPLAY, RESUMED
from bus.wire.runs import data_head
from feeding import frame_record

if TYPE_CHECKING:
    from broker_world import Process

Answer = TypeVar("Answer", bound=m.Message)


class Sample(NamedTuple):
    """One sample, as received by the process of its subscription."""

    source: int
    seq: int
    payload: str
    stamp_ns: int
    is_replay: bool


def ring_name(gid: bytes) -> str:
    """A name in place of the descriptor of that publisher's ring."""
    return f"ring {int.from_bytes(gid, 'big')}"


class _Endpoint:
    def __init__(self, process: "Process", created: m.Created, gid: bytes) -> None:
        self.process = process
        self.created = created
        self.id = EndpointId(created.id)
        self.gid = gid

    def statistics(self, asker: "Process | None" = None) -> m.EndpointStatistics:
        """The broker's counters in the graph for `asker` (default: the endpoint's process)."""
        records = (asker or self.process).graph(statistics=True).endpoints
        (found,) = (record.statistics for record in records if record.id == self.id)
        assert found is not None
        return found

    def got(self, kind: type[Answer]) -> list[Answer]:
        """The messages of one kind about this endpoint."""
        names = ("endpoint", "publisher" if isinstance(self, Publisher) else "subscription")
        return [
            one for one in self.process.got(kind) if any(getattr(one, name, 0) == self.id for name in names)
        ]

    def destroy(self) -> None:
        self.process.tell(m.DestroyEndpoint(endpoint=self.id))


class Publisher(_Endpoint):
    def __init__(self, process: "Process", created: m.Created, gid: bytes, next_seq: int) -> None:
        super().__init__(process, created, gid)
        self.next_seq = next_seq
        self.ring = ring_name(gid)
        self._flags = 0

    def publish(self, *payloads: str, stamp_ns: int | None = None) -> None:
        """Publish all payloads in one run."""
        stamp_ns = self.process.world.now_ns if stamp_ns is None else stamp_ns
        body = b"".join(frame_record(payload.encode(), stamp_ns) for payload in payloads)
        self.publish_body(len(payloads), body)

    def publish_many(self, payloads: Iterable[str]) -> None:
        """Publish each payload in a separate run."""
        for payload in payloads:
            self.publish(payload)

    def publish_body(self, count: int, body: bytes, *, first_seq: int | None = None) -> None:
        """Send a data frame with any body."""
        first_seq = self.next_seq if first_seq is None else first_seq
        self.next_seq = first_seq + count
        length = DATA_HEAD_BYTES - LENGTH_BYTES + len(body)
        head = DATA_HEAD.pack(length, DATA, self._flags, 0, self.id, 0, first_seq, count, 0)
        self._flags = 0
        self.process.send_bytes(head + body)

    def lose(self, number: int) -> None:
        """Skip `number` samples: the publisher's queue replaced them before they were handed over."""
        self.next_seq += number

    def resume(self, seq: int) -> None:
        """Continue at `seq`: earlier samples went by another route."""
        self.next_seq = seq
        self._flags = RESUMED

    def catch_up(
        self, subscription: "Subscription", *payloads: str, first_seq: int = 1, is_replay: bool = False
    ) -> None:
        """Send samples only to one subscription, as after Rerouted."""
        if payloads:
            stamp_ns = self.process.world.now_ns
            body = b"".join(frame_record(payload.encode(), stamp_ns) for payload in payloads)
            flags = REPLAY if is_replay else 0
            head = data_head(
                self.id, first_seq, len(payloads), len(body), flags=flags, only_for=subscription.id
            )
            self.process.send_bytes(head + body)
        self.process.tell(m.CaughtUp(publisher=self.id, subscription=subscription.id))

    def refuse(self, subscription: "Subscription", text: str = "no") -> None:
        self.process.tell(m.RefuseRoute(endpoint=self.id, other=subscription.id, text=text))


class Subscription(_Endpoint):
    @property
    def samples(self) -> list[Sample]:
        return self.process.samples.get(self.id, [])

    @property
    def payloads(self) -> list[str]:
        return [sample.payload for sample in self.samples]

    @property
    def undecodable(self) -> int:
        """Samples in runs that were shorter than announced."""
        return self.process.undecodable.get(self.id, 0)

    def attach(self, publisher: Publisher, slot: int = 0) -> None:
        self.process.tell(m.Attach(subscription=self.id, source=publisher.id, slot=slot))

    def refuse(self, publisher: Publisher, text: str = "no") -> None:
        self.process.tell(m.RefuseRoute(endpoint=self.id, other=publisher.id, text=text))

    def ack(self, publisher: Publisher, seq: int) -> None:
        self.process.tell(m.Ack(subscription=self.id, source=publisher.id, seq=seq))
