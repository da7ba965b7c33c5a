"""The topic `ros_discovery_info` in its two forms: of ROS 2 Humble, and of later distros.

The forms differ in the size of gids. Readers of one form don't understand writers of the other.
"""

import asyncio
import time
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final

from bus_bridge.dds import raw
from bus_bridge.dds.graph import GID_SIZE, NodeEntities, encode
from bus_bridge.dds.names import GRAPH_TOPIC, GRAPH_TYPE_HASH, user_data
from bus_bridge.dds.participant import Endpoint, Participant
from bus_bridge.ros2 import samples
from bus_bridge.ros2.type_names import type_to_dds
from bus_bridge.rtps.policies import TRANSIENT_LOCAL, Policies

__all__ = ["NodeTopic", "NodeWriter", "info_type"]

_POLICIES: Final = Policies(durability=TRANSIENT_LOCAL)
_ALL: Final = Policies(durability=TRANSIENT_LOCAL, keep_all=True)


class NodeTopic:
    """Makes endpoints of the topic. Each has `mark` in its USER_DATA."""

    def __init__(self, participant: Participant, mark: dict[str, str]) -> None:
        self.participant = participant
        self._mark = mark

    def make_writer(self, size: int) -> Endpoint:
        """Make a writer in the form with gids of `size` bytes."""
        data = self._user_data(size)
        return self.participant.make_writer(GRAPH_TOPIC, info_type(size), _POLICIES, data, None)

    def make_reader(self, size: int, on_data: Callable[[], object]) -> Endpoint:
        """Make a reader in the form with gids of `size` bytes. `on_data` is called in a thread of Cyclone."""
        data = self._user_data(size)
        return self.participant.make_reader(GRAPH_TOPIC, info_type(size), _ALL, data, on_data)

    def _user_data(self, size: int) -> bytes:
        typehash = {"typehash": GRAPH_TYPE_HASH} if size == GID_SIZE else {}
        return user_data({**typehash, **self._mark})


class NodeWriter:
    """Publishes our nodes, which `nodes` returns, in one of the two forms."""

    def __init__(self, topic: NodeTopic, size: int, nodes: Callable[[], Sequence[NodeEntities]]) -> None:
        self.size = size
        """The size of gids in the current form."""
        self._topic = topic
        self._nodes = nodes
        self._endpoint = topic.make_writer(size)
        self._said = b""
        self._due: asyncio.Handle | None = None

    def change(self, size: int) -> None:
        """Use the other form."""
        self.size = size
        self._endpoint.close()
        self._endpoint = self._topic.make_writer(size)
        self._said = b""
        self.say()

    def say(self) -> None:
        """Publish our nodes soon: once for all changes in one turn of the loop."""
        if self._due is None:
            self._due = asyncio.get_running_loop().call_soon(self._write)

    def close(self) -> None:
        """Stop publishing."""
        if self._due is not None:
            self._due.cancel()

    def _write(self) -> None:
        self._due = None
        data = encode(self._topic.participant.guid, self._nodes(), self.size)
        if data != self._said:
            raw.writer_of(self._endpoint.entity)(samples.padded(data), time.time_ns())
            self._said = data


@cache
def info_type(gid_size: int) -> Any:
    """The topic's type for cyclonedds."""
    from cyclonedds.idl import make_idl_struct, types

    def make(name: str, fields: dict[str, Any]) -> Any:
        return make_idl_struct(
            f"{name}_", type_to_dds(f"rmw_dds_common/msg/{name}"), fields, dataclassify=False
        )

    text: Any = types.bounded_str[256]
    gid = make("Gid", {"data": types.array[types.uint8, gid_size]})
    gids: Any = types.sequence[gid]
    fields = {"node_namespace": text, "node_name": text, "reader_gid_seq": gids, "writer_gid_seq": gids}
    nodes: Any = types.sequence[make("NodeEntitiesInfo", fields)]
    return make("ParticipantEntitiesInfo", {"gid": gid, "node_entities_info_seq": nodes})
