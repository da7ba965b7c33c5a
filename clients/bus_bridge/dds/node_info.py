"""`ros_discovery_info`: the topic on which participants of ROS 2, and the bridge, list their nodes.

Owns: our readers and our writer. `node_form` decides the form (of two) of the writer, `node_topic` makes the
endpoints, and `graph` the contents.
"""

import asyncio
from collections.abc import Callable, Sequence
from typing import Final

from bus_bridge.dds import raw
from bus_bridge.dds.graph import NodeEntities, decode
from bus_bridge.dds.node_form import NodeForm, size_of
from bus_bridge.dds.node_topic import NodeTopic, NodeWriter
from bus_bridge.dds.options import Distro
from bus_bridge.dds.participant import Endpoint, Participant

__all__ = ["NodeInfo"]

_PROBE_AFTER_S: Final = 0.1
_PROBE_AGAIN_S: Final = 1.0
_MOST_PROBES: Final = 10
"""For each writer: it may never send anything."""
_MOST_EARLY: Final = 1000


class NodeInfo:
    """Lists of nodes, sent and received. Made with the participant; `close` belongs to the participant.

    `nodes` are ours. `on_nodes` is called with the nodes of each participant, `warn` with texts for the user.
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
        self._topic = NodeTopic(participant, mark)
        self._loop = asyncio.get_running_loop()
        self._on_nodes = on_nodes
        self._form = NodeForm(distro, warn)
        self._writer = NodeWriter(self._topic, self._form.size, nodes)
        self._readers: dict[int, Endpoint] = {}
        self._writers: dict[int, tuple[bytes, int]] = {}
        """The far participant and the size of its gids, by handle of the writer."""
        self._early: dict[int, bytes] = {}
        """Data that came before discovery found its writer, by handle."""
        self._ignored: set[int] = set()
        self._silent: dict[int, int] = {}
        """Writers that have sent nothing yet, by handle, with their numbers of further probes."""
        self._probes: list[Endpoint] = []
        self._timer: asyncio.TimerHandle | None = None
        self._is_closed = False
        self._listen(self._form.size)

    def close(self) -> None:
        """Stop sending and receiving."""
        self._is_closed = True
        self._writer.close()
        if self._timer is not None:
            self._timer.cancel()

    def say(self) -> None:
        """Send our nodes soon."""
        if not self._is_closed:
            self._writer.say()

    def writer_added(self, handle: int, participant: bytes, is_humble: bool) -> None:
        """Handle a participant's writer found by discovery."""
        size = size_of(is_humble=is_humble)
        self._writers[handle] = participant, size
        self._listen(size)
        if self._form.follow(size, (one for _, one in self._writers.values())):
            self._writer.change(size)
        self._silent[handle] = _MOST_PROBES
        if (early := self._early.pop(handle, None)) is not None:
            self._receive(handle, early)
        elif self._timer is None:
            self._timer = self._loop.call_later(_PROBE_AFTER_S, self._probe)

    def ignore(self, handle: int) -> None:
        """Ignore a writer, because it belongs to a busd."""
        self._ignored.add(handle)
        self._early.pop(handle, None)

    def writer_removed(self, handle: int) -> None:
        """Remove a writer."""
        self._writers.pop(handle, None)
        self._ignored.discard(handle)
        self._silent.pop(handle, None)
        self._early.pop(handle, None)

    def _listen(self, size: int) -> None:
        if size not in self._readers:
            self._readers[size] = self._make_reader(size)

    def _make_reader(self, size: int) -> Endpoint:
        return self._topic.make_reader(size, lambda: self._loop.call_soon_threadsafe(self._take))

    def _probe(self) -> None:
        """Make a new reader, to get the data of silent writers.

        Fast DDS sends its kept data when it finds a reader. If we have not found its writer by then, it sends
        again only after up to three seconds. A new reader gets the data at once.
        """
        self._timer = None
        while self._probes:
            self._probes.pop().close()
        if self._silent and not self._is_closed:
            for size in {self._writers[handle][1] for handle in self._silent}:
                self._probes.append(self._make_reader(size))
            self._silent = {handle: left - 1 for handle, left in self._silent.items() if left > 1}
            self._timer = self._loop.call_later(_PROBE_AGAIN_S, self._probe)

    def _take(self) -> None:
        if self._is_closed:
            return
        for reader in (*self._readers.values(), *self._probes):
            take = raw.taker_of(reader.entity)
            while found := take(64):
                for data, info in found:
                    if info.valid_data and info.publication_handle not in self._ignored:
                        self._receive(info.publication_handle, data)

    def _receive(self, handle: int, data: bytes) -> None:
        """Handle data. If both forms are in use, data may come twice: each of our readers receives from every
        writer."""
        if handle not in self._writers:
            if len(self._early) >= _MOST_EARLY:
                self._early.pop(next(iter(self._early)))
            self._early[handle] = data
            return
        owner, size = self._writers[handle]
        self._silent.pop(handle, None)
        try:
            participant, nodes = decode(data, size)
        except ValueError:
            return  # another layout: a ROS 2 older than Humble, or not ROS 2
        if participant[:12] == owner[:12]:
            self._on_nodes(owner, nodes)
