"""The routes in from publishers of ROS 2 on zenoh: one subscription in zenoh for each topic and type.

All publishers of a topic use one key. The gid in the attachment says which of them a message comes from.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from bus.endpoint.core import summed
from bus.qos import Durability
from bus.vocabulary import DropReason
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.engine import FarEndpoint
from bus_bridge.rmw_zenoh import attachment
from bus_bridge.rmw_zenoh.session import RosSession
from bus_bridge.ros2.early import Early
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.zenoh.records import MAX_NUMBER
from bus_bridge.zenoh.session import Declared
from bus_ros.cdr import CdrError

__all__ = ["Intake", "Intakes", "RosReader"]

_SOURCE_BYTES: Final = 64 << 20
_PUT_BYTES: Final = 256
"""The cost of a message besides its payload and its attachment."""
_EARLY_BYTES: Final = 16 << 20
_EARLY_S: Final = 5.0
"""The time after the begin of an intake, or the announcement of a publisher, in which messages wait for their
route."""

Arrived = tuple[bytes, int, int]
"""The CDR of a message, its number, and its time of publication."""


class Intakes:
    """All intakes of a session. `warn` gets texts for the user."""

    def __init__(self, session: RosSession, warn: Callable[[str], None]) -> None:
        self.session = session
        self.warn = warn
        self._by_key: dict[str, Intake] = {}
        self._announced: dict[bytes, float] = {}
        """When each present publisher was announced."""

    def hold(self, key: str, known: KnownType) -> "Intake":
        """The intake of a key, for one more user, which must call `release`."""
        intake = self._by_key.get(key)
        if intake is None:
            intake = self._by_key[key] = Intake(self, key, known)
        intake.users += 1
        return intake

    def drop(self, key: str) -> None:
        """An intake has no more users."""
        del self._by_key[key]

    def publisher_came(self, gid: bytes) -> None:
        self._announced[gid] = asyncio.get_running_loop().time()

    def publisher_gone(self, gid: bytes) -> None:
        self._announced.pop(gid, None)
        for intake in self._by_key.values():
            intake.forget(gid)

    def is_early(self, gid: bytes, opened_s: float) -> bool:
        """Whether a route for messages of a publisher may still be made."""
        now_s = asyncio.get_running_loop().time()
        return now_s < max(opened_s, self._announced.get(gid, now_s)) + _EARLY_S

    def sweep(self) -> None:
        """Forget messages whose route was not made in time. To be called about once a second."""
        for intake in self._by_key.values():
            intake.sweep()


class Intake:
    """The subscription of one key in zenoh; made by `Intakes.hold`."""

    def __init__(self, intakes: Intakes, key: str, known: KnownType) -> None:
        self.users = 0
        self._intakes = intakes
        self._key = key
        self._known = known
        self._opened_s = asyncio.get_running_loop().time()
        self._readers: dict[bytes, RosReader] = {}
        self._early: Early[bytes, Arrived] = Early(known.depth, _EARLY_BYTES)
        self._early_since: dict[bytes, float] = {}
        self._fresh: list[RosReader] = []
        """Readers with messages that are not passed on yet."""
        self._with_history = False
        self._source = intakes.session.source(self._take, _SOURCE_BYTES, self._lose, after=self._give)
        self._subscriber = self._subscribe()

    def release(self) -> None:
        """One user less."""
        self.users -= 1
        if not self.users:
            self._subscriber.undeclare()
            self._source.close()
            self._early.clear()
            self._intakes.drop(self._key)

    def attach(self, reader: "RosReader", *, wants_history: bool) -> None:
        """Pass the messages of a publisher to `reader`, first its early messages.

        They are given soon: the caller counts the losses of a reader that it has.
        """
        self._readers[reader.gid] = reader
        self._early_since.pop(reader.gid, None)
        early, lost = self._early.pop(reader.gid)
        for reason, count in lost.items():
            reader.lose(reason, count)
        for cdr, number, time_ns in early:
            reader.receive(cdr, number, time_ns)
        asyncio.get_running_loop().call_soon(reader.give)
        if wants_history:
            self._with_history = True
            former, self._subscriber = self._subscriber, self._subscribe()
            former.undeclare()

    def detach(self, reader: "RosReader") -> None:
        if self._readers.get(reader.gid) is reader:
            del self._readers[reader.gid]

    def warn_of_number(self) -> None:
        self._intakes.warn(
            f"messages on '{self._key:.300}' are dropped: no publisher has numbers like theirs"
        )

    def forget(self, gid: bytes) -> None:
        """A publisher has gone."""
        self._early_since.pop(gid, None)
        self._early.pop(gid)

    def sweep(self) -> None:
        now_s = asyncio.get_running_loop().time()
        for gid in [gid for gid, since_s in self._early_since.items() if now_s - since_s > _EARLY_S]:
            self.forget(gid)

    def _subscribe(self) -> Declared:
        push = self._source.push
        return self._intakes.session.hear(
            self._key,
            lambda payload, head: push((payload, head), len(payload) + len(head) + _PUT_BYTES),
            with_history=self._with_history,
        )

    def _lose(self, message: tuple[bytes, bytes]) -> None:  # in zenoh's thread
        head = attachment.read(message[1])
        reader = None if head is None else self._readers.get(head.gid)
        if reader is not None:
            reader.left_out += 1

    def _take(self, message: tuple[bytes, bytes]) -> None:
        cdr, head = message
        found = attachment.read(head)
        if found is None:
            self._intakes.warn(
                f"messages on '{self._key:.300}' are dropped: they have no attachment of ROS 2's rmw_zenoh"
            )
            return
        number, time_ns, gid = max(found.number, 0), found.time_ns, found.gid
        reader = self._readers.get(gid)
        if reader is not None:
            if reader.receive(cdr, number, time_ns):
                self._fresh.append(reader)
        elif self._intakes.is_early(gid, self._opened_s) and self._early.put(gid, (cdr, number, time_ns)):
            self._early_since[gid] = asyncio.get_running_loop().time()

    def _give(self) -> None:
        fresh, self._fresh = self._fresh, []
        for reader in fresh:
            reader.give()


class RosReader:
    """The route in from one publisher of ROS 2."""

    def __init__(
        self, intake: Intake, endpoint: FarEndpoint, known: KnownType, on_batch: Callable[[Batch], None]
    ) -> None:
        self.gid = endpoint.gid
        self.left_out = 0
        """Messages without room between zenoh's thread and the loop. Only that thread writes it."""
        self._lost: dict[str, int] = {}
        self._intake = intake
        self._decode = known.codec.decode
        self._on_batch = on_batch
        self._samples: list[Sample] = []
        self._last = 0
        self._is_closed = False
        intake.attach(self, wants_history=endpoint.qos.durability is Durability.TRANSIENT_LOCAL)

    @property
    def lost(self) -> dict[str, int]:
        """Messages that arrived and were lost, by reason."""
        return summed(self._lost, {DropReason.MEMORY_LIMIT: self.left_out} if self.left_out else {})

    def receive(self, cdr: bytes, number: int, time_ns: int) -> bool:
        """Take a message; returns whether it is the first since the last `give`."""
        if 0 < number <= self._last:
            self.lose(DropReason.REPEATED)  # mostly a history that came again, for another publisher's sake
            return False
        if number > MAX_NUMBER:
            self._intake.warn_of_number()
            self.lose(DropReason.UNDECODABLE)
            return False
        try:
            sample = Sample(self._decode(cdr), number, time_ns)
        except CdrError:
            self.lose(DropReason.UNDECODABLE)
            return False
        self._last = max(self._last, number)
        self._samples.append(sample)
        return len(self._samples) == 1

    def give(self) -> None:
        """Pass on the messages that were received."""
        samples, self._samples = self._samples, []
        if samples and not self._is_closed:
            self._on_batch(Loose(samples))

    def lose(self, reason: DropReason, count: int = 1) -> None:
        self._lost[reason] = self._lost.get(reason, 0) + count

    def taken(self, size: int) -> None:
        """Nothing waits for this: zenoh has no acknowledgments that reach a publisher."""

    def close(self) -> None:
        if not self._is_closed:
            self._is_closed = True
            self._intake.detach(self)
            self._intake.release()
