"""The carrier of topics on our own RTPS: one participant, its discovery, and its routes.

Owns: the readers and writers of this bus in RTPS, and which reader carries the messages of a far writer. It
serves if cyclonedds is not installed, as on machines for which it has no package.

RTPS numbers every message. So each message of a far writer is passed on once, by the strongest of the readers
that are matched with it. If another reader takes over, it continues after the last number. A new one takes
over once the writer knows it, and its messages follow directly on those of the present one. A retired reader
stays until then, for a second at most.
"""

import asyncio
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Final

from bus.vocabulary import DropReason
from bus_bridge.batch import Batch, Loose, Sample
from bus_bridge.dds import qos
from bus_bridge.dds.carrier import Discovered, Listener, NodeTopic, TopicReader, TopicWriter
from bus_bridge.dds.graph import GID_SIZE, NodeEntities, decode, encode
from bus_bridge.dds.names import (
    ENCLAVE,
    GRAPH_TOPIC,
    GRAPH_TYPE_HASH,
    MARK,
    kind_of,
    topic_to_dds,
    user_data,
    user_data_of,
)
from bus_bridge.dds.node_form import NodeForm, size_of
from bus_bridge.dds.options import Distro
from bus_bridge.engine import FarEndpoint, LocalEndpoint, Reader
from bus_bridge.ros2 import samples
from bus_bridge.ros2.early import Early
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.ros2.route_out import RouteOut
from bus_bridge.ros2.type_names import type_to_dds
from bus_bridge.rtps.announcements import EndpointData, ParticipantData
from bus_bridge.rtps.ids import PARTICIPANT, PREFIX_BYTES
from bus_bridge.rtps.local import Local
from bus_bridge.rtps.policies import TRANSIENT_LOCAL, Policies
from bus_bridge.rtps.reach import Reach
from bus_bridge.rtps.reader import Arrived
from bus_bridge.rtps.running import RunningParticipant
from bus_bridge.rtps.writer import Keeping
from bus_ros.cdr import CdrError

__all__ = ["RtpsCarrier"]

_KEPT_BYTES: Final = 64 << 20
_LOSSLESS: Final = 10_000
"""Messages of a lossless publisher that far readers have not acknowledged. Above that, it waits."""
_LOOK_S: Final = 0.005
_HANDOVER_S: Final = 1.0
"""The longest time for which a retired reader is still used. Far writers know a new one in milliseconds."""
_EARLY_BYTES: Final = 8 << 20
_EARLY_BYTES_OF_ALL: Final = 64 << 20
"""The limit for early messages of subscriptions with keep all."""
_PATIENCE_S: Final = 10.0
"""Time for which messages of a writer wait for their route. Messages that it keeps for late joiners wait
longer."""
_LATCHED: Final = Policies(durability=TRANSIENT_LOCAL)
_GRAPH_TYPE: Final = type_to_dds("rmw_dds_common/msg/ParticipantEntitiesInfo")

_NumberedArrival = tuple[bytes, int, int]
"""A message in CDR, its number, and its time of publication."""


class RtpsCarrier:
    """A Carrier. `mark` is in the USER_DATA of everything of ours. Raises BridgeError like
    RunningParticipant."""

    has_numbers = True

    def __init__(self, domain: int, reach: Reach, mark: dict[str, str], distro: Distro = "auto") -> None:
        self._mark = mark
        self._loop = asyncio.get_running_loop()
        self._listener: Listener | None = None
        self._warn: Callable[[str], None] = lambda text: None
        self._is_due = False
        self._readers: defaultdict[str, list[_Reader]] = defaultdict(list)
        """Our readers by topic."""
        self._routes: dict[bytes, _Route] = {}
        """Routes in, by GUID of the far writer."""
        self._carrying: dict[bytes, _Reader] = {}
        """The reader that carries the messages of a far writer."""
        self._last: dict[bytes, int] = {}
        """The last number of writers that were read before, by GUID."""
        self.participant = RunningParticipant(
            domain, self, _is_wanted, reach=reach, user_data=user_data({ENCLAVE: "/", **mark})
        )
        self._nodes = _Nodes(self.participant, distro, mark)

    def open(
        self,
        listener: Listener,
        nodes: Callable[[], Sequence[NodeEntities]],
        warn: Callable[[str], None],
    ) -> NodeTopic:
        self._listener, self._warn = listener, warn
        self._nodes.open(nodes, listener, warn)
        return self._nodes

    def say_nodes(self) -> None:
        self._nodes.say()

    def make_writer(
        self,
        endpoint: LocalEndpoint,
        known: KnownType,
        policies: Policies,
        on_change: Callable[[], None],
        on_close: Callable[[TopicWriter], object],
    ) -> TopicWriter:
        topic, data = topic_to_dds(endpoint.topic), self._data(known)
        writer = _Writer(self.participant, topic, known, policies, data, on_change, on_close)
        self._loop.call_soon(writer.update)
        return writer

    def make_reader(self, endpoint: LocalEndpoint, known: KnownType, policies: Policies) -> "_Reader":
        reader = _Reader(self, topic_to_dds(endpoint.topic), known, policies, self._data(known))
        self._readers[reader.topic].append(reader)
        self.choose(reader.topic)
        return reader

    def retire_reader(self, reader: TopicReader) -> None:
        assert isinstance(reader, _Reader)
        reader.is_retiring = True
        self._retire(reader, self._loop.time() + _HANDOVER_S)

    def read(
        self,
        endpoint: FarEndpoint,
        handle: int,
        known: KnownType,
        on_batch: Callable[[Batch], None],
        *,
        restores: bool,
    ) -> Reader:
        gid = endpoint.gid
        if restores:  # a retiring reader does not get them again
            self._last.pop(gid, None)
            self._carrying.pop(gid, None)
        route = _Route(self, gid, known, on_batch)
        route.last = self._last.get(gid, 0)
        self._routes[gid] = route
        self.choose(topic_to_dds(endpoint.topic))
        carrying = self._carrying.get(gid)
        if carrying is not None:
            early, lost = carrying.early.pop(gid)
            for reason, count in lost.items():
                route.lose(reason, count)
            route.early.extend(early)
            self._loop.call_soon(route.take, ())  # not now: the caller does not have this object yet
        return route

    def update(self) -> None:
        for topic in list(self._readers):
            self.choose(topic)
        listener = self._listener
        if listener is not None:
            for gid in [gid for gid in self._last if not listener.is_mirrored(gid)]:
                del self._last[gid]

    def leave(self) -> None:
        self._nodes.close()
        self.participant.close()

    def close(self) -> None:
        """There are no threads; everything has ended already."""
        self.participant.close()

    # --- for the parts in this file

    def choose(self, topic: str) -> None:
        """Choose the reader that carries the messages of each far writer of a topic.

        The present one stays, even if it retires: the writer may not know a new one yet. See `_takes_over`.
        """
        matched: defaultdict[bytes, list[_Reader]] = defaultdict(list)
        for reader in sorted(self._readers.get(topic, ()), key=lambda one: one.rank):
            for gid in reader.local.matched:
                matched[gid].append(reader)
        for gid, readers in matched.items():
            present, best = self._carrying.get(gid), readers[-1]
            has_more = best.policies.transient_local and not self._passed_on(gid)
            if present not in readers or (has_more and best.is_stronger_than(present)):
                self._carrying[gid] = best

    def arrived(self, reader: "_Reader", one: Arrived) -> None:
        """Handle a message that one of our readers has received."""
        if one.payload is None:
            return
        gid = one.writer
        carrying = self._carrying.get(gid)
        if carrying is None:
            self.choose(reader.topic)
            carrying = self._carrying.get(gid)
        if carrying is not reader and not self._takes_over(reader, one):
            return
        arrival = one.payload, one.number, one.time_ns or time.time_ns()
        route = self._routes.get(gid)
        if route is not None:
            route.take([arrival])
        elif gid not in self._last and not self._is_marked(gid):  # a route may be on its way
            self._keep_early(reader, gid, arrival)

    def route_closed(self, route: "_Route") -> None:
        if self._routes.get(route.gid) is route:
            del self._routes[route.gid]
            self._last[route.gid] = route.last

    # --- news of the participant

    def participant_added(self, data: ParticipantData) -> None:
        if self._listener is not None:
            self._listener.participant_added(data.prefix + PARTICIPANT, user_data_of(data.user_data))
            self._changed()

    def participant_removed(self, prefix: bytes) -> None:
        if self._listener is not None:
            self._listener.participant_removed(prefix + PARTICIPANT)
            self._changed()

    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None:
        if self._listener is None:
            return
        self._listener.endpoint_added(
            Discovered(
                _handle(endpoint.guid),
                endpoint.guid[:PREFIX_BYTES] + PARTICIPANT,
                "publisher" if endpoint.kind == "writer" else "subscription",
                endpoint.guid,
                endpoint.topic,
                endpoint.type_name,
                endpoint.policies,
                user_data_of(endpoint.user_data),
            )
        )
        self._changed()

    def endpoint_removed(self, endpoint: EndpointData) -> None:
        if self._listener is not None:
            self._listener.endpoint_removed(endpoint.guid, _handle(endpoint.guid))
            self._changed()
        for reader in self._readers.get(endpoint.topic, ()):
            reader.early.pop(endpoint.guid)
        self._carrying.pop(endpoint.guid, None)

    def warn(self, text: str) -> None:
        self._warn(text)

    # --- inside

    def _keep_early(self, reader: "_Reader", gid: bytes, arrival: _NumberedArrival) -> None:
        """Keep a message of a writer for its route, which may be on its way."""
        is_first = reader.early.put(gid, arrival)
        if is_first and not reader.policies.transient_local:
            self._loop.call_later(_PATIENCE_S, reader.early.pop, gid)

    def _is_marked(self, gid: bytes) -> bool:
        """Whether a writer belongs to a refused participant."""
        return self._listener is not None and self._listener.is_marked(_handle(gid))

    def _passed_on(self, gid: bytes) -> int:
        """The number of the last message of a writer that was passed on."""
        route = self._routes.get(gid)
        return self._last.get(gid, 0) if route is None else route.last

    def _takes_over(self, reader: "_Reader", one: Arrived) -> bool:
        """Whether a reader carries the messages of a writer from this one on: it is preferred to the present
        one, and nothing is missing between them."""
        present = self._carrying.get(one.writer)
        if present is None or not reader.rank > present.rank or reader.newest(one.writer) is None:
            return False
        if one.number > self._passed_on(one.writer) + 1:
            return False
        self._carrying[one.writer] = reader
        return True

    def _retire(self, reader: "_Reader", end_s: float) -> None:
        """End a reader once others have its writers, or at that time."""
        if not self._hand_over(reader) and self._loop.time() < end_s:
            self._loop.call_later(_LOOK_S, self._retire, reader, end_s)
            return
        of_topic = self._readers[reader.topic]
        of_topic.remove(reader)
        if not of_topic:
            del self._readers[reader.topic]
        for gid in reader.local.matched:
            if self._carrying.get(gid) is reader:
                del self._carrying[gid]
        early = {gid: reader.early.pop(gid)[0] for gid in tuple(reader.early)}
        reader.close()
        self.choose(reader.topic)
        for gid, arrivals in early.items():
            if (heir := self._carrying.get(gid)) is not None:
                for one in arrivals:
                    self._keep_early(heir, gid, one)

    def _hand_over(self, reader: "_Reader") -> bool:
        """Give the writers of a retiring reader to readers that miss nothing. Returns False if a reader may
        take over another one later."""
        carried = [gid for gid in reader.local.matched if self._carrying.get(gid) is reader]
        is_done = True
        others = [(one, set(one.local.matched)) for one in self._readers[reader.topic] if not one.is_retiring]
        for gid in carried:
            passed_on = self._passed_on(gid)
            heirs = [one for one, matched in others if gid in matched]
            ready = [one for one in heirs if (last := one.newest(gid)) is not None and last <= passed_on]
            if ready:
                self._carrying[gid] = max(ready, key=lambda one: one.rank)
            elif heirs:
                is_done = False
        return is_done

    def _changed(self) -> None:
        """Report the change after the endpoints were matched, once for many."""
        if not self._is_due:
            self._is_due = True
            self._loop.call_soon(self._report)

    def _report(self) -> None:
        self._is_due = False
        if self._listener is not None:
            self._listener.changed()

    def _data(self, known: KnownType) -> bytes:
        return user_data({"typehash": known.codec.type_hash, **self._mark})


class _Writer(RouteOut):
    """The route out of a publisher."""

    def __init__(
        self,
        participant: RunningParticipant,
        topic: str,
        known: KnownType,
        policies: Policies,
        data: bytes,
        on_change: Callable[[], None],
        on_close: Callable[[RouteOut], object],
    ) -> None:
        super().__init__(known, on_change, on_close)
        self._participant = participant
        self._most = _LOSSLESS if policies.keep_all else 0
        self._match_timer: asyncio.TimerHandle | None = None
        changes = _LOSSLESS + 1 if policies.keep_all else policies.depth
        self._local = participant.add_writer(
            topic,
            type_to_dds(known.codec.type_name),
            policies=policies,
            user_data=data,
            keeping=Keeping(changes, _KEPT_BYTES, for_late_joiners=policies.transient_local),
        )
        assert self._local.writer is not None
        self._writer = self._local.writer
        self.gid = self._local.guid

    @property
    def lost(self) -> dict[str, int]:
        if not self._writer.lost:
            return self._losses
        return {**self._losses, DropReason.REPLACED: self._writer.lost}

    def _has_reader(self) -> bool:
        readers = self._local.matched
        has_one = any(map(self._writer.is_known_to, readers))
        if readers and not has_one and self._match_timer is None:
            # RTPS gives no news of the first acknowledgment. It comes within milliseconds of the match. A
            # message before it could be replaced before it has arrived.
            self._match_timer = self._loop.call_later(_LOOK_S, self._look_again)
        return has_one

    def _look_again(self) -> None:
        self._match_timer = None
        self.update()

    def _send(self, cdr: bytes, time_ns: int) -> bool:
        out = self._writer
        if self._most and (out.waiting >= self._most or out.waiting_bytes >= _KEPT_BYTES // 2):
            return False  # a lossless publisher waits
        self._participant.write(self._local, cdr, time_ns=time_ns)
        return True

    def _end(self) -> None:
        if self._match_timer is not None:
            self._match_timer.cancel()
        self._participant.remove(self._local)


class _Reader:
    """A reader for a subscription of this bus."""

    def __init__(
        self, carrier: RtpsCarrier, topic: str, known: KnownType, policies: Policies, data: bytes
    ) -> None:
        self.topic = topic
        self.policies = policies
        self.is_retiring = False
        """Its subscription has gone. It carries messages until other readers have taken over its writers."""
        self.early: Early[bytes, _NumberedArrival] = (
            Early(None, _EARLY_BYTES_OF_ALL) if policies.keep_all else Early(known.depth, _EARLY_BYTES)
        )
        """Messages that came before the bridge had a route for them."""
        self._participant = carrier.participant
        self.local = carrier.participant.add_reader(
            topic,
            type_to_dds(known.codec.type_name),
            lambda one: carrier.arrived(self, one),
            policies=policies,
            user_data=data,
        )

    @property
    def gid(self) -> bytes:
        return self.local.guid

    @property
    def rank(self) -> tuple[bool, tuple[bool, bool, bool, int]]:
        """Sort key: the reader with the highest one carries a writer's messages."""
        return not self.is_retiring, qos.strength(self.policies)

    def is_stronger_than(self, other: "_Reader") -> bool:
        return qos.strength(self.policies) > qos.strength(other.policies)

    def newest(self, gid: bytes) -> int | None:
        """As of a Reader of RTPS."""
        reader = self.local.reader
        return None if reader is None else reader.newest(gid)

    def close(self) -> None:
        self.early.clear()
        self._participant.remove(self.local)


class _Route:
    """The route in from one far publisher: the result of `read`."""

    def __init__(
        self, carrier: RtpsCarrier, gid: bytes, known: KnownType, on_batch: Callable[[Batch], None]
    ) -> None:
        self.gid = gid
        self.last = 0
        """The number of the last message that was passed on."""
        self.lost: dict[str, int] = {}
        self.early: list[_NumberedArrival] = []
        """Messages to pass on before all others."""
        self._carrier = carrier
        self._decode = known.codec.decode
        self._on_batch = on_batch
        self._is_closed = False

    def take(self, arrivals: Sequence[_NumberedArrival]) -> None:
        """Pass on messages with new numbers, in order."""
        early, self.early = self.early, []
        samples = []
        for cdr, number, time_ns in (*early, *arrivals):
            if number <= self.last:
                continue
            self.last = number
            try:
                samples.append(Sample(self._decode(cdr), number, time_ns))
            except CdrError:
                self.lose(DropReason.UNDECODABLE)
        if samples and not self._is_closed:
            self._on_batch(Loose(samples))

    def lose(self, reason: DropReason, count: int = 1) -> None:
        self.lost[reason] = self.lost.get(reason, 0) + count

    def taken(self, size: int) -> None:
        """Does nothing: no writer of DDS waits for it."""

    def close(self) -> None:
        self._is_closed = True
        self._carrier.route_closed(self)


class _Nodes:
    """The topic `ros_discovery_info`: our nodes, and the nodes of other participants."""

    def __init__(self, participant: RunningParticipant, distro: Distro, mark: dict[str, str]) -> None:
        self._participant = participant
        self._distro = distro
        self._mark = mark
        self._sizes: dict[bytes, int] = {}
        """Sizes of gids, by GUID of the far writer."""
        self._due: asyncio.Handle | None = None
        self._said = b""

    def open(
        self,
        nodes: Callable[[], Sequence[NodeEntities]],
        listener: Listener,
        warn: Callable[[str], None],
    ) -> None:
        self._nodes, self._listener = nodes, listener
        self._form = NodeForm(self._distro, warn)
        self._writer = self._make_writer()
        self._participant.add_reader(
            GRAPH_TOPIC,
            _GRAPH_TYPE,
            self._arrived,
            policies=_LATCHED._replace(keep_all=True),
            user_data=self._user_data(GID_SIZE),
        )

    def say(self) -> None:
        """Send our nodes soon: once for all changes in one turn of the loop."""
        if self._due is None:
            self._due = self._participant.loop.call_soon(self._write)

    def close(self) -> None:
        if self._due is not None:
            self._due.cancel()

    def writer_added(self, handle: int, participant: bytes, is_humble: bool) -> None:
        size = self._sizes[_gid(handle)] = size_of(is_humble=is_humble)
        if self._form.follow(size, self._sizes.values()):
            self.say()

    def writer_removed(self, handle: int) -> None:
        self._sizes.pop(_gid(handle), None)

    def ignore(self, handle: int) -> None:
        """Its messages are ignored anyway: its size is not known."""

    def _make_writer(self) -> Local:
        self._size = self._form.size
        return self._participant.add_writer(
            GRAPH_TOPIC,
            _GRAPH_TYPE,
            policies=_LATCHED,
            user_data=self._user_data(self._size),
            keeping=Keeping(changes=1, for_late_joiners=True),
        )

    def _user_data(self, size: int) -> bytes:
        typehash = {"typehash": GRAPH_TYPE_HASH} if size == GID_SIZE else {}
        return user_data({**typehash, **self._mark})

    def _write(self) -> None:
        self._due = None
        if self._size != self._form.size:
            self._participant.remove(self._writer)
            self._writer = self._make_writer()
            self._said = b""
        data = encode(self._participant.prefix + PARTICIPANT, self._nodes(), self._size)
        if data != self._said:
            self._participant.write(self._writer, samples.padded(data))
            self._said = data

    def _arrived(self, one: Arrived) -> None:
        size = self._sizes.get(one.writer)
        if one.payload is None or size is None:
            return
        try:
            participant, nodes = decode(one.payload, size)
        except ValueError:
            return  # another layout: a ROS 2 older than Humble, or not ROS 2
        if participant[:PREFIX_BYTES] == one.writer[:PREFIX_BYTES]:
            self._listener.nodes_said(one.writer[:PREFIX_BYTES] + PARTICIPANT, nodes)


def _is_wanted(endpoint: EndpointData) -> bool:
    return kind_of(endpoint.topic) != "other" and MARK not in user_data_of(endpoint.user_data)


def _handle(gid: bytes) -> int:
    return int.from_bytes(gid, "big")


def _gid(handle: int) -> bytes:
    return handle.to_bytes(GID_SIZE, "big")
