"""The carrier of topics on cyclonedds: one participant, its discovery, and its routes.

Owns: cyclonedds' built-in readers. The other modules of cyclonedds do the separate tasks.
"""

import asyncio
from collections.abc import Callable, Sequence
from typing import Any, Final

from bus_bridge.batch import Batch
from bus_bridge.dds.carrier import Discovered, Listener, NodeTopic, TopicReader, TopicWriter
from bus_bridge.dds.first_heartbeat import FirstHeartbeats
from bus_bridge.dds.graph import NodeEntities
from bus_bridge.dds.names import ENCLAVE, topic_to_dds, user_data, user_data_of
from bus_bridge.dds.node_info import NodeInfo
from bus_bridge.dds.options import DdsOptions
from bus_bridge.dds.participant import Participant, policies_of, user_data_in
from bus_bridge.dds.reading import FarWay, Intake, Ways
from bus_bridge.dds.writing import DdsWriter
from bus_bridge.engine import EndpointKind, FarEndpoint, LocalEndpoint, Reader
from bus_bridge.ros2.known_types import KnownType
from bus_bridge.rtps.policies import Policies

__all__ = ["CycloneCarrier"]

_ALIVE: Final = 16
_BATCH: Final = 256


class CycloneCarrier:
    """A Carrier. `mark` is in the USER_DATA of everything of ours. Raises BridgeError like Participant.

    `ask_for_heartbeat`: as of an RTPS participant in the same domain.
    """

    has_numbers = False

    def __init__(
        self, options: DdsOptions, mark: dict[str, str], ask_for_heartbeat: Callable[[bytes, bytes], None]
    ) -> None:
        self._options = options
        self._mark = mark
        # Its threads and sockets take some milliseconds, and no other task runs yet.
        self.participant = Participant(options, user_data({ENCLAVE: "/", **mark}))
        self._loop = asyncio.get_running_loop()
        self._first_heartbeats = FirstHeartbeats(ask_for_heartbeat)
        self._scheduled: set[str] = set()
        self._builtin: dict[str, Any] = {}
        self._is_closed = False

    def open(
        self,
        listener: Listener,
        nodes: Callable[[], Sequence[NodeEntities]],
        warn: Callable[[str], None],
    ) -> NodeTopic:
        self._listener = listener
        self.ways = Ways(
            listener.is_marked,
            lambda intake, writer: self._first_heartbeats.matched(intake.gid, intake.policies, writer),
        )
        self._node_info = NodeInfo(
            self.participant, self._options.distro, self._mark, nodes, listener.nodes_said, warn
        )
        for what in ("DcpsParticipant", "DcpsPublication", "DcpsSubscription"):
            self._builtin[what] = self.participant.watch(what, self._waker(what))
            self._schedule(what)
        return self._node_info

    def say_nodes(self) -> None:
        self._node_info.say()

    def make_writer(
        self,
        endpoint: LocalEndpoint,
        known: KnownType,
        policies: Policies,
        on_change: Callable[[], None],
        on_close: Callable[[TopicWriter], object],
    ) -> TopicWriter:
        return DdsWriter(
            self.participant,
            topic_to_dds(endpoint.topic),
            known,
            policies,
            self._user_data(known),
            on_change,
            on_close,
            is_far=self._listener.is_far,
        )

    def make_reader(self, endpoint: LocalEndpoint, known: KnownType, policies: Policies) -> Intake:
        topic = topic_to_dds(endpoint.topic)
        intake = Intake(self.ways, self.participant, topic, known, policies, self._user_data(known))
        self.ways.add(intake)
        return intake

    def retire_reader(self, reader: TopicReader) -> None:
        assert isinstance(reader, Intake)
        self.ways.retire(reader)

    def read(
        self,
        endpoint: FarEndpoint,
        handle: int,
        known: KnownType,
        on_batch: Callable[[Batch], None],
        *,
        restores: bool,
    ) -> Reader:
        way = FarWay(self.ways, endpoint.gid, handle, topic_to_dds(endpoint.topic), known, on_batch)
        self.ways.begin(way, restores=restores)
        return way

    def update(self) -> None:
        self.ways.keep_only(self._listener.is_mirrored)

    def leave(self) -> None:
        self._is_closed = True
        self._node_info.close()
        self.ways.close()
        self.participant.leave()

    def close(self) -> None:
        self.participant.close()

    # --- discovery

    def _waker(self, what: str) -> Callable[[], None]:
        def wake() -> None:  # in a thread of Cyclone
            if what not in self._scheduled:
                self._scheduled.add(what)
                self._loop.call_soon_threadsafe(self._drain, what)

        return wake

    def _schedule(self, what: str) -> None:
        self._scheduled.add(what)
        self._loop.call_soon(self._drain, what)

    def _drain(self, what: str) -> None:
        self._scheduled.discard(what)
        if self._is_closed or what not in self._builtin:
            return
        listener = self._listener
        samples = self._builtin[what].take(_BATCH)
        for sample in samples:
            is_alive = sample.sample_info.instance_state == _ALIVE
            guid = sample.key.bytes
            if what == "DcpsParticipant":
                if is_alive:
                    listener.participant_added(guid, user_data_of(user_data_in(sample.qos)))
                else:
                    listener.participant_removed(guid)
            elif not is_alive:
                listener.endpoint_removed(guid, sample.sample_info.instance_handle)
            elif sample.participant_key.bytes != self.participant.guid:
                kind: EndpointKind = "publisher" if what == "DcpsPublication" else "subscription"
                listener.endpoint_added(
                    Discovered(
                        sample.sample_info.instance_handle,
                        sample.participant_key.bytes,
                        kind,
                        guid,
                        sample.topic_name,
                        sample.type_name,
                        policies_of(sample.qos),
                        user_data_of(user_data_in(sample.qos)),
                    )
                )
        if len(samples) == _BATCH:
            self._schedule(what)
        if samples:
            listener.changed()

    def _user_data(self, known: KnownType) -> bytes:
        return user_data({"typehash": known.codec.type_hash, **self._mark})
