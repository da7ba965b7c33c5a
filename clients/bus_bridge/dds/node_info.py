"""`ros_discovery_info`: what the participants of ROS 2 say of their nodes, and what we say of ours.

Owns: our writer, our readers, and in which of the two forms they speak. What is said is in `graph`.
"""

import asyncio
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from bus_bridge.dds import raw
from bus_bridge.dds.graph import GID_SIZE, HUMBLE_GID_SIZE, NodeEntities, decode, encode
from bus_bridge.dds.names import GRAPH_TOPIC, GRAPH_TYPE_HASH, type_to_dds, user_data
from bus_bridge.dds.options import Distro
from bus_bridge.dds.participant import Endpoint, Participant
from bus_bridge.dds.qos import Policies

__all__ = ["NodeInfo"]

_POLICIES: Final = Policies(transient_local=True)
_PROBE_AFTER_S: Final = 0.1
_PROBE_AGAIN_S: Final = 1.0
_MOST_EARLY: Final = 1000
_ALL: Final = Policies(transient_local=True, keep_all=True)


class NodeInfo:
    """Made with the participant; `close` is the participant's own.

    `nodes` are ours, `on_nodes` hears of each participant's, `warn` what the user should know.
    """

    def __init__(
        self,
        participant: Participant,
        distro: Distro,
        mark: dict[str, str],
        nodes: Callable[[], Sequence[NodeEntities]],
        on_nodes: Callable[[bytes, list[NodeEntities]], None],
        warn: Callable[[str], None],
    ) -> None:
        self._participant = participant
        self._loop = asyncio.get_running_loop()
        self._mark = mark
        self._nodes = nodes
        self._on_nodes = on_nodes
        self._warn = warn
        self._is_fixed = distro != "auto"
        self._size = HUMBLE_GID_SIZE if distro == "humble" else GID_SIZE
        self._types: dict[int, Any] = {}
        self._readers: dict[int, Endpoint] = {}
        self._writers: dict[int, tuple[bytes, int]] = {}
        """By handle: the far participant, and the size of its gids."""
        self._early: dict[int, bytes] = {}
        """By handle, what was said before discovery told of the writer."""
        self._ignored: set[int] = set()
        self._silent: set[int] = set()
        """Handles of writers that have said nothing yet."""
        self._probes: list[Endpoint] = []
        self._timer: asyncio.TimerHandle | None = None
        self._said = b""
        self._is_due = False
        self._is_closed = False
        self._writer = self._make_writer()
        self._listen(self._size)

    def close(self) -> None:
        """Nothing is said or heard any more."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()

    def say(self) -> None:
        """Tell our nodes, soon: what changes in one turn of the loop is told once."""
        if not self._is_due:
            self._is_due = True
            self._loop.call_soon(self._write)

    def writer_came(self, handle: int, participant: bytes, is_humble: bool) -> None:
        """Discovery has found a participant's writer."""
        size = HUMBLE_GID_SIZE if is_humble else GID_SIZE
        self._writers[handle] = participant, size
        self._listen(size)
        if not self._is_fixed and size != self._size:
            sizes = {size for _, size in self._writers.values()}
            if len(sizes) == 2:
                self._warn(
                    "nodes of ROS 2 Humble and of later distros are in this domain: they can't see each "
                    "other's nodes, and those of Humble don't see the nodes of this bus (their topics work)"
                )
            if size == GID_SIZE or len(sizes) == 1:
                self._size = size
                self._writer.close()
                self._writer = self._make_writer()
                self._said = b""
                self.say()
        self._silent.add(handle)
        if (early := self._early.pop(handle, None)) is not None:
            self._hear(handle, early)
        elif self._timer is None:
            self._timer = self._loop.call_later(_PROBE_AFTER_S, self._probe)

    def ignore(self, handle: int) -> None:
        """That writer is a busd's."""
        self._ignored.add(handle)
        self._early.pop(handle, None)

    def writer_went(self, handle: int) -> None:
        """It is there no more."""
        self._writers.pop(handle, None)
        self._ignored.discard(handle)
        self._silent.discard(handle)

    def _make_writer(self) -> Endpoint:
        typehash = {"typehash": GRAPH_TYPE_HASH} if self._size == GID_SIZE else {}
        data = user_data({**typehash, **self._mark})
        return self._participant.make_writer(GRAPH_TOPIC, self._type(self._size), _POLICIES, data, None)

    def _listen(self, size: int) -> None:
        if size not in self._readers:
            self._readers[size] = self._make_reader(size)

    def _make_reader(self, size: int) -> Endpoint:
        typehash = {"typehash": GRAPH_TYPE_HASH} if size == GID_SIZE else {}
        return self._participant.make_reader(
            GRAPH_TOPIC,
            self._type(size),
            _ALL,
            user_data({**typehash, **self._mark}),
            lambda: self._loop.call_soon_threadsafe(self._take),
        )

    def _probe(self) -> None:
        """Ask those that are silent once more.

        Fast DDS sends what it keeps when it finds a reader, and if we have not found its writer by then,
        again after up to three seconds. A new reader gets it at once.
        """
        self._timer = None
        while self._probes:
            self._probes.pop().close()
        if self._silent and not self._is_closed:
            for size in {self._writers[handle][1] for handle in self._silent}:
                self._probes.append(self._make_reader(size))
            self._timer = self._loop.call_later(_PROBE_AGAIN_S, self._probe)

    def _take(self) -> None:
        if self._is_closed:
            return
        for reader in (*self._readers.values(), *self._probes):
            take = raw.taker_of(reader.entity)
            while found := take(64):
                for data, info in found:
                    if info.valid_data and info.publication_handle not in self._ignored:
                        self._hear(info.publication_handle, data)

    def _hear(self, handle: int, data: bytes) -> None:
        """Where both forms are spoken, it may come twice: each of our readers hears every writer."""
        if handle not in self._writers:
            if len(self._early) >= _MOST_EARLY:
                self._early.pop(next(iter(self._early)))
            self._early[handle] = data
            return
        owner, size = self._writers[handle]
        self._silent.discard(handle)
        try:
            participant, nodes = decode(data, size)
        except ValueError:
            return  # another layout: an older ROS 2 than Humble, or no ROS 2 at all
        if participant[:12] == owner[:12]:
            self._on_nodes(owner, nodes)

    def _write(self) -> None:
        self._is_due = False
        if self._is_closed:
            return
        data = encode(self._participant.guid, self._nodes(), self._size)
        if data != self._said:
            raw.writer_of(self._writer.entity)(data.ljust(-(-len(data) // 4) * 4, b"\0"), time.time_ns())
            self._said = data

    def _type(self, size: int) -> Any:
        if size not in self._types:
            self._types[size] = _info_type(size)
        return self._types[size]


def _info_type(gid_size: int) -> Any:
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
