"""The routes in: DDS readers for subscriptions of this bus, and the choice of a reader for each far writer.

Each reader receives from all far writers of its topic. The strongest of the readers matched with a writer
carries its messages. A reader that gets the writer's history is stronger than a reader without it; a reliable
reader is stronger than a best-effort one. If the chosen reader is closed, another takes over, and no message
is repeated or missing.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Final

from bus.vocabulary import DropReason
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.dds import raw
from bus_bridge.dds.participant import Participant
from bus_bridge.dds.qos import strength
from bus_bridge.ros2.early import Arrived, Early
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.rtps.policies import Policies
from bus_ros.cdr import CdrError

__all__ = ["TRANSITIONS", "FarWay", "Intake", "IntakeError", "IntakeEvent", "IntakeState", "Ways"]

_BATCH: Final = 256
_BURST: Final = 16
"""After this number of messages at once, polling in each turn of the loop costs less than a call for each."""
_LINGER_S: Final = 0.02
"""Time for which a withdrawn reader still carries messages. After it, the other reader has received all
messages of this one."""
_CATCH_UP_S: Final = 1.0
"""Time after a change of readers in which messages may come a second time."""
_EARLY_BYTES: Final = 8 * 2**20
_EARLY_BYTES_OF_ALL: Final = 64 * 2**20
"""The limit for early messages of subscriptions with keep all."""
_PATIENCE_S: Final = 10.0
"""Time for which messages of a writer wait until its route is ready. Messages that it keeps for late joiners
wait longer."""


class IntakeState(Enum):
    """Whether a reader is in use."""

    OPEN = "open"
    RETIRING = "retiring"
    """Its subscription has gone. It is used a moment longer, until other readers have its messages."""
    CLOSED = "closed"


class IntakeEvent(Enum):
    """Events that change the state."""

    RETIRE = "retire"
    """Its subscription has gone."""
    CLOSE = "close"
    """It is no longer used, or the bridge ends."""


TRANSITIONS: Final[Mapping[IntakeState, Mapping[IntakeEvent, IntakeState]]] = {
    IntakeState.OPEN: {
        IntakeEvent.RETIRE: IntakeState.RETIRING,
        IntakeEvent.CLOSE: IntakeState.CLOSED,
    },
    IntakeState.RETIRING: {IntakeEvent.CLOSE: IntakeState.CLOSED},
    IntakeState.CLOSED: {},
}
"""The next state, by state and event. An event that is missing in the row of a state must not happen in
it."""


class IntakeError(Exception):
    """An event that is not possible in the current state: a bug in the bridge."""


class Intake:
    """One DDS reader."""

    def __init__(
        self,
        ways: "Ways",
        participant: Participant,
        topic: str,
        known: KnownType,
        policies: Policies,
        user_data: bytes,
    ) -> None:
        self._ways = ways
        self._loop = asyncio.get_running_loop()
        self.topic = topic
        self.policies = policies
        self.matched: set[int] = set()
        """Handles of the far writers that it is matched with."""
        self.state = IntakeState.OPEN
        self._is_scheduled = False
        self._is_hushed = False
        """Whether it is polled in each turn of the loop, and DDS does not call back."""
        self._holds = 0
        self._early: Early[int, Arrived] = (
            Early(None, _EARLY_BYTES_OF_ALL) if policies.keep_all else Early(known.depth, _EARLY_BYTES)
        )
        """Messages that arrived before a reader was chosen for them."""
        self._settled: set[int] = set()
        """Handles of writers for which a reader was chosen, or for which none was needed."""
        # The first callback may come before the constructor has returned.
        self._endpoint = participant.make_reader(
            topic, known.idl, policies, user_data, self._wake, lambda: self._in_loop(self.update_matches)
        )
        self._take = raw.taker_of(self._endpoint.entity)
        self.gid = self._endpoint.guid
        self._in_loop(self.update_matches)
        self._wake()

    def on(self, event: IntakeEvent) -> None:
        """Handle `event`. Raises IntakeError if it is not possible in this state. Only this method changes
        the state."""
        state = TRANSITIONS[self.state].get(event)
        if state is None:
            way = f"a reader of DDS on '{self.topic}'"
            raise IntakeError(f"{way} is {self.state.value!r}: {event.value!r} can't happen to it")
        self.state = state

    def update_matches(self) -> None:
        """Update the matched writers after a possible change."""
        if self.state is IntakeState.CLOSED:
            return
        former, self.matched = self.matched, set(self._endpoint.matched_writers())
        for handle in self.matched - former:
            if (writer := self._endpoint.guid_of_writer(handle)) is not None:
                self._ways.on_match(self, writer)
        for handle in [handle for handle in self._early if handle not in self.matched]:
            self._early.pop(handle)
        self._settled &= self.matched
        self._ways.choose_all(self.topic)

    def early(self, handle: int) -> tuple[Sequence[Arrived], Mapping[DropReason, int]]:
        """The messages of that writer so far, and the number of lost ones by reason. Later messages go to its
        route."""
        self._settled.add(handle)
        return self._early.pop(handle)

    def hold(self) -> None:
        """Leave new messages in DDS' own history."""
        self._holds += 1

    def release(self) -> None:
        """Continue after `hold`."""
        self._holds -= 1
        self._wake()

    def drain(self) -> bool:
        """Take a batch of messages. Returns whether there may be more."""
        self._is_scheduled = False
        if self.state is IntakeState.CLOSED or self._holds:
            return False  # `release` polls it again
        found = self._take(_BATCH)
        batches: dict[FarWay, list[Arrived]] = {}
        ways = self._ways.by_handle
        for data, info in found:
            if not info.valid_data:
                continue
            handle = info.publication_handle
            way = ways.get(handle)
            if way is not None and way.carrier is self:
                batches.setdefault(way, []).append((data, info.source_timestamp))
            elif handle not in self._settled and (way is None or handle not in self.matched):
                self._keep(handle, (data, info.source_timestamp))
        for way, batch in batches.items():
            way.arrived(batch)
        if len(found) >= _BURST and not self._is_hushed:
            self._is_hushed = True
            self._endpoint.hush(True)
        elif not found and self._is_hushed:
            self._is_hushed = False
            self._endpoint.hush(False)
            self._wake()
        if (self._is_hushed or len(found) == _BATCH) and not self._is_scheduled:
            self._is_scheduled = True
            self._loop.call_soon(self.drain)
        return len(found) == _BATCH

    def close(self) -> None:
        """End the reader."""
        if self.state is not IntakeState.CLOSED:
            self.on(IntakeEvent.CLOSE)
            self._early.clear()
            self._endpoint.close()

    def _keep(self, handle: int, one: Arrived) -> None:
        if self._ways.is_marked(handle):
            return
        if self._early.put(handle, one) and not self.policies.transient_local:
            self._loop.call_later(_PATIENCE_S, self._give_up, handle)

    def _give_up(self, handle: int) -> None:
        if handle in self.matched:
            self.early(handle)

    def _wake(self) -> None:  # also called in a thread of Cyclone
        if not self._is_scheduled:
            self._is_scheduled = True
            self._in_loop(self.drain)

    def _in_loop(self, call: Callable[[], object]) -> None:
        self._loop.call_soon_threadsafe(call)


class FarWay:
    """The route in from one far publisher: the result of `read`."""

    def __init__(
        self,
        ways: "Ways",
        gid: bytes,
        handle: int,
        topic: str,
        known: KnownType,
        on_batch: Callable[[Batch], None],
    ) -> None:
        self.gid = gid
        self.handle = handle
        self.topic = topic
        self.lost: dict[str, int] = {}
        self.carrier: Intake | None = None
        self.last_ns = 0
        """The time of publication of the newest message that was passed on."""
        self._known_ns = 0
        """The value of `last_ns` when the carrier changed. The new carrier may bring messages up to it once
        more."""
        self._catches_up_until = 0.0
        self._ways = ways
        self._decode = known.codec.decode
        self._on_batch = on_batch
        self._loop = asyncio.get_running_loop()
        self._early: list[Arrived] = []
        self._is_closed = False

    def begin(self, carrier: Intake | None) -> None:
        """Use `carrier` for its messages from now on. Earlier messages are passed on, too, if they are
        new."""
        self.carrier = carrier
        if carrier is None:
            return
        early, lost = carrier.early(self.handle)
        for reason, count in lost.items():
            self._lose(reason, count)
        if self.last_ns:
            self._known_ns, self._catches_up_until = self.last_ns, self._loop.time() + _CATCH_UP_S
            early = [one for one in early if one[1] > self._known_ns]
        if early:
            self.last_ns = early[-1][1]
            self._early.extend(early)
            self._loop.call_soon(self._flush)  # not now: the caller does not have this object yet

    def arrived(self, batch: Sequence[Arrived]) -> None:
        """Pass on messages, in order."""
        self._flush()
        if self._catches_up_until:
            batch = [one for one in batch if one[1] > self._known_ns]
            if self._loop.time() >= self._catches_up_until:
                self._catches_up_until = 0.0
        if batch:
            self.last_ns = batch[-1][1]
            self._pass_on(batch)

    def _flush(self) -> None:
        if self._early:
            early, self._early = self._early, []
            self._pass_on(early)

    def _pass_on(self, batch: Sequence[Arrived]) -> None:
        if self._is_closed:
            return
        decode = self._decode
        try:
            samples = [Sample(decode(data), 0, time_ns) for data, time_ns in batch]
        except CdrError:
            samples = self._right_ones(batch)
        if samples:
            self._on_batch(Loose(samples))

    def _right_ones(self, batch: Sequence[Arrived]) -> list[Sample]:
        samples = []
        for data, time_ns in batch:
            try:
                samples.append(Sample(self._decode(data), 0, time_ns))
            except CdrError:
                self._lose(DropReason.UNDECODABLE)
        return samples

    def taken(self, size: int) -> None:
        """Does nothing: no writer of DDS waits for it. Messages without room wait in the bridge and are
        counted there."""

    def close(self) -> None:
        self._is_closed = True
        self._ways.end(self)

    def _lose(self, reason: DropReason, count: int = 1) -> None:
        self.lost[reason] = self.lost.get(reason, 0) + count


class Ways:
    """All readers and routes in. `is_marked` says whether the writer with that handle is another busd's: then
    it is ignored. `on_match` is called with a reader and the GUID of a writer after each new match."""

    def __init__(self, is_marked: Callable[[int], bool], on_match: Callable[[Intake, bytes], None]) -> None:
        self.is_marked = is_marked
        self.on_match = on_match
        self._lingering: set[Intake] = set()
        self._loop = asyncio.get_running_loop()
        self._intakes: dict[str, list[Intake]] = {}
        self.by_handle: dict[int, FarWay] = {}
        self._by_topic: dict[str, dict[int, FarWay]] = {}
        self._last_ns: dict[bytes, int] = {}
        """The time of the last message of publishers that were read before, by gid."""

    def close(self) -> None:
        """End all readers at once."""
        for intakes in self._intakes.values():
            for intake in intakes:
                intake.close()
        for intake in self._lingering:
            intake.close()

    def add(self, intake: Intake) -> None:
        """Add a new reader."""
        self._intakes.setdefault(intake.topic, []).append(intake)

    def retire(self, intake: Intake) -> None:
        """Retire the reader of a subscription that has gone. It ends at once if it carries nothing, or if it
        is the only reader of its topic."""
        if intake.state is IntakeState.RETIRING:
            return
        if intake.state is IntakeState.OPEN:
            intake.on(IntakeEvent.RETIRE)
        self._intakes[intake.topic].remove(intake)
        if not self._intakes[intake.topic]:
            del self._intakes[intake.topic]
        # A new reader is an heir, too: it is matched soon.
        heirs = set(self._intakes.get(intake.topic, ())) if self._carried(intake) else set()
        if not heirs:
            self._finish(intake, heirs)
            return
        for heir in heirs:
            heir.hold()
        self._lingering.add(intake)
        self._loop.call_later(_LINGER_S, self._finish, intake, heirs)

    def begin(self, way: FarWay, *, restores: bool) -> None:
        """Start the route of a far publisher. `restores`: messages may come again."""
        way.last_ns = 0 if restores else self._last_ns.get(way.gid, 0)
        self.by_handle[way.handle] = way
        self._by_topic.setdefault(way.topic, {})[way.handle] = way
        self._choose(way)

    def end(self, way: FarWay) -> None:
        """End the route of a far publisher."""
        if self.by_handle.get(way.handle) is way:
            del self.by_handle[way.handle]
            del self._by_topic[way.topic][way.handle]
            if not self._by_topic[way.topic]:
                del self._by_topic[way.topic]
            self._last_ns[way.gid] = way.last_ns
        for intake in self._intakes.get(way.topic, ()):
            intake.early(way.handle)
        way.carrier = None

    def keep_only(self, is_there: Callable[[bytes], bool]) -> None:
        """Forget other publishers than these: they have gone for good."""
        for gid in [gid for gid in self._last_ns if not is_there(gid)]:
            del self._last_ns[gid]

    def choose_all(self, topic: str) -> None:
        """Choose the readers of a topic again after a possible change of matches."""
        for way in list(self._by_topic.get(topic, {}).values()):
            self._choose(way)

    def _choose(self, way: FarWay) -> None:
        if way.carrier is not None and way.carrier.state is IntakeState.RETIRING:
            return  # `_finish` calls this later
        best = self._best(way)
        if best is way.carrier:
            return
        while way.carrier is not None and way.carrier.drain():
            pass
        way.begin(best)

    def _carried(self, intake: Intake) -> list[FarWay]:
        return [way for way in self._by_topic.get(intake.topic, {}).values() if way.carrier is intake]

    def _best(self, way: FarWay) -> Intake | None:
        candidates = [one for one in self._intakes.get(way.topic, ()) if way.handle in one.matched]
        return max(candidates, key=lambda one: (strength(one.policies), one is way.carrier), default=None)

    def _finish(self, intake: Intake, heirs: set[Intake]) -> None:
        carried = self._carried(intake)
        while heirs and intake.drain():
            pass
        intake.close()
        self._lingering.discard(intake)
        for way in carried:
            way.begin(self._best(way))
        for heir in heirs:
            heir.release()
