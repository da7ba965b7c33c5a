"""A bridge: shows each side the nodes of the other, and carries messages between them, until it is closed."""

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from time import monotonic, monotonic_ns
from typing import Any

import msgspec

from bus.diagnostics.provoked import inform, warn
from bus.graph import Origin
from bus.node import Node
from bus_bridge.core.announcing import Announcing
from bus_bridge.core.bounds import Bounds
from bus_bridge.core.exports import Exports
from bus_bridge.core.far_graph import FarGraph, Wrong
from bus_bridge.core.journal import Journal
from bus_bridge.core.local_graph import LocalGraph
from bus_bridge.core.mirrors import Mirrors
from bus_bridge.core.naming import Naming
from bus_bridge.core.reporting import Reporting
from bus_bridge.core.rules import Rules
from bus_bridge.core.schemas import Schemas
from bus_bridge.core.status import GetStatus
from bus_bridge.engine import Engine, FarBus, FarEndpoint, FarNode
from bus_bridge.errors import in_words

__all__ = ["Bridge", "BridgeOptions"]

_MOST_SAID = 1000
_CLOSE_S = 0.3
_PERIOD_S = 1.0
_SWEEP_S = 0.25


class BridgeOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of a bridge, without its engine's."""

    bus: str
    """The id of this bus (`bus_id`)."""
    rules: Rules
    naming: Naming
    bounds: Bounds = msgspec.field(default_factory=Bounds)
    socket: Path | None = None
    """Path of busd's socket, as for the bridge's own node."""
    journal: Path | None = None
    """File for the last numbers, for the next process (`journal`); None: no file."""


class Bridge:
    """Connects the bus of `node`, which is open, with the buses that `engine` reaches. It is that engine's
    far side.

    `node` belongs to the bridge. Its origin is this bus, so no bridge shows it to others.

        async with bus.Node("bridge_zenoh", origin=bus.Origin("zenoh", options.bus)) as node:
            await Bridge(node, engine, options).run()
    """

    def __init__(self, node: Node, engine: Engine, options: BridgeOptions) -> None:
        self._node = node
        self._engine = engine
        self._options = options
        self._loop = asyncio.get_running_loop()
        self._log = node.get_logger()
        self._began_s = monotonic()
        self._said: OrderedDict[str, None] = OrderedDict()
        rules, naming, bounds = options.rules, options.naming, options.bounds
        self._far = FarGraph(options.bus, bounds, rules, naming)
        self._local = LocalGraph(rules, naming, engine.only_bus)
        self._schemas = Schemas(node, engine, bounds.schema_bytes, self._blame)
        self._exports = Exports(node, rules, self._local.knows, self._local.hides, self.warn)
        self._announcing = Announcing(node, engine, self._local, self._exports, self.warn)
        self._journal = self._open_journal()
        self._mirrors = Mirrors(
            engine,
            self._far,
            self._exports,
            self._schemas,
            self._make_node,
            self._local.knows,
            self.warn,
            self._journal,
        )
        self._reporting = Reporting(self._exports, self._mirrors)

    async def run(self, on_open: Callable[[], object] = lambda: None) -> None:
        """Connect both sides until cancelled; calls `on_open` after the start of the engine.

        Raises BridgeError if the engine can't start, and busd's error if it refuses something.

        Cancellation is the normal end. Within a second, neither side sees nodes of the other any more.
        """
        tasks: list[asyncio.Task[Any]] = []
        try:
            await self._engine.open(self)
            await self._node.create_service(GetStatus, "~/get_status", lambda request: self.status())
            on_open()
            tasks += [
                self._loop.create_task(self._announcing.watch(), name="announce"),
                self._loop.create_task(self._mirrors.run(), name="mirror"),
                self._loop.create_task(self._keep_time(), name="keep time"),
            ]
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            await self._close(tasks)

    def reconfigure(self, rules: Rules, naming: Naming) -> None:
        """Apply other rules, and other far names, but no other namespace.

        Topics for which nothing has changed lose no message. Others end, come, or are shown again.
        """
        self._far.reconfigure(rules, naming)
        self._local.reconfigure(rules, naming)
        self._exports.reconfigure(rules)
        self._announcing.look_again()
        self._mirrors.notify()

    async def _close(self, tasks: list[asyncio.Task[Any]]) -> None:
        for task in tasks:
            task.cancel()
        self._exports.close()
        self._schemas.close()
        await asyncio.gather(*tasks, return_exceptions=True)
        for close in (self._engine.close, self._mirrors.close):
            try:
                async with asyncio.timeout(_CLOSE_S):
                    await close()
            except TimeoutError:
                pass  # it ends with the process
            except Exception as error:
                self._log.warning(f"while the bridge was closed: {in_words(error)}")
        if self._journal is not None:
            self._journal.close()

    async def _keep_time(self) -> None:
        report_s = self._loop.time()
        while True:
            await asyncio.sleep(_SWEEP_S)
            self._exports.sweep()
            if self._loop.time() >= report_s:
                report_s = self._loop.time() + _PERIOD_S
                if self._journal is not None:
                    self._journal.live(monotonic_ns())
                self._reporting.report(self._loop.time())

    def _open_journal(self) -> Journal | None:
        path = self._options.journal
        try:
            return None if path is None else Journal(path, monotonic_ns())
        except OSError as error:
            reason = "another bridge has it open" if isinstance(error, BlockingIOError) else error.strerror
            self._log.info(f"messages missed before a restart will not be counted: {path}: {reason}")
            return None

    def _make_node(self, name: str, namespace: str, origin: Origin) -> Node:
        return Node(
            name,
            namespace=namespace,
            arguments=(),
            socket=self._options.socket,
            rosout=False,
            origin=origin,
        )

    def status(self) -> GetStatus.Response:
        """The state of the bridge, as its service reports it."""
        return self._reporting.status(
            engine=self._engine,
            bus=self._options.bus,
            namespace=self._options.naming.namespace,
            uptime_s=monotonic() - self._began_s,
            buses=self._far.buses,
            shown_there=self._announcing.counts,
        )

    # --- calls by the engine

    def bus_added(self, bus: FarBus) -> None:
        if wrong := self._far.bus_added(bus, self._loop.time()):
            self._refuse(wrong)
            return
        self._mirrors.bus_added(bus.id)
        self._mirrors.notify()
        inform(self._log, f"bus '{bus.id}' is there")

    def bus_removed(self, bus_id: str, reason: str) -> None:
        if bus_id not in self._far.buses:
            return
        inform(self._log, f"bus '{bus_id}' has gone: {reason}")
        self._mirrors.bus_removed(bus_id)
        self._far.bus_removed(bus_id)
        self._mirrors.notify()

    def node_added(self, node: FarNode) -> None:
        self._judge(self._far.node_added(node, self._loop.time()))

    def node_removed(self, key: str) -> None:
        self._judge(self._far.node_removed(key, self._loop.time()))

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        self._judge(self._far.endpoint_added(endpoint, self._loop.time()))
        ways = self._far.ways(endpoint.gid)
        if len(ways) > 1:
            self.warn(
                f"the {endpoint.kind} on '{endpoint.topic}' arrives by more than one way, from the buses "
                f"{', '.join(map(repr, ways))}; the first is used"
            )

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        self._judge(self._far.endpoint_removed(gid, node, self._loop.time()))

    def warn(self, text: str) -> None:
        if text in self._said:
            self._said.move_to_end(text)
            return
        self._said[text] = None
        if len(self._said) > _MOST_SAID:
            self._said.popitem(last=False)
        warn(self._log, text)  # limited, because a far side can cause any number

    # --- internal

    def _judge(self, wrong: Wrong | None) -> None:
        if wrong:
            self._refuse(wrong)
        self._mirrors.notify()

    def _blame(self, endpoint: FarEndpoint, reason: str) -> None:
        if wrong := self._far.wrong(endpoint.node, reason):
            self._refuse(wrong)

    def _refuse(self, wrong: Wrong) -> None:
        who = f"{wrong.announcer} of bus '{wrong.bus}'" if wrong.announcer else f"bus '{wrong.bus}'"
        self.warn(f"{who} is refused: {wrong.reason}")
        self._far.forget(wrong)
        self._mirrors.notify()
        self._engine.refuse(wrong.bus, wrong.reason, wrong.announcer)
