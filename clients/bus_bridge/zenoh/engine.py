"""The engine for zenoh: shows this bus, and finds other buses, by zenoh's tokens and keys."""

import asyncio
import secrets
import time
from collections.abc import Callable, Sequence

from bus.schema import MessageSchema
from bus_bridge.batch import Batch
from bus_bridge.engine import FarEndpoint, FarSide, LinkStatus, LocalEndpoint, LocalNode, RouteRule
from bus_bridge.errors import BridgeError, in_words
from bus_bridge.zenoh import keys, records
from bus_bridge.zenoh.groups import write_run
from bus_bridge.zenoh.links import Links
from bus_bridge.zenoh.options import ZenohOptions, check
from bus_bridge.zenoh.own_log import OwnLog
from bus_bridge.zenoh.presence import MAX_TOKENS, Interest, Presence
from bus_bridge.zenoh.reading import ZenohReader
from bus_bridge.zenoh.session import Declared, Query, Session
from bus_bridge.zenoh.writing import ZenohWriter

__all__ = ["ZenohEngine"]

_LOOK_S = 1.0
_ASK_SCHEMA_S = 2.0
_ASK_SCHEMA_TIMES = 3
_MAX_QUERIES = 10_000
_UNFINISHED_BYTES = 512 << 20
"""The most that pieces of all far publishers together may use while other pieces are missing."""


class ZenohEngine:
    """An Engine. `bus`: the id of this bus, which must be unique. Raises BridgeError for impossible or
    forbidden options."""

    name = "zenoh"
    has_numbers = True
    only_bus = ""

    def __init__(self, bus: str, options: ZenohOptions, *, owns_process: bool = False) -> None:
        """`owns_process`: the engine may take over stdout, because zenoh reports refused connections only
        there."""
        self._owns_process = owns_process
        self._log: OwnLog | None = None
        self._options = options
        self._warnings = check(options)
        # Later runs sort after earlier ones; the random part separates two runs of the same moment.
        run = f"{time.time_ns():016x}{secrets.token_hex(4)}"
        self._own = Interest(bus, write_run(options.groups, run))
        self._session: Session | None = None
        self._far: FarSide | None = None
        self._presence: Presence | None = None
        self._links: Links | None = None
        self._own_token: Declared | None = None
        self._declared: list[Declared] = []
        """The declarations that receive news of others and answer them."""
        self._nodes: dict[int, Declared] = {}
        self._schemas: dict[tuple[str, str], tuple[bytes, int]] = {}
        """The description of each type, and its number of endpoints."""
        self._writers: dict[bytes, ZenohWriter] = {}
        self._readers: dict[tuple[bytes, str], ZenohReader] = {}
        """Readers by gid and bus."""
        self._room = records.Room(_UNFINISHED_BYTES)
        self._crowd: set[tuple[str, str]] = set()
        self._looking: asyncio.Task[None] | None = None

    async def open(self, far: FarSide) -> None:
        """As `Engine.open`."""
        self._far = far
        if self._owns_process and self._options.listen:
            self._log = OwnLog(far.warn)
            self._log.open()
        session = Session(self._options, self._see_fault)
        await session.open()
        self._session = session
        for text in self._warnings:
            far.warn(text)
        self._presence = Presence(self._own.bus, self._own.run, far, self._see_interests)
        self._links = Links(self._options, session, far.warn)
        tokens = session.source(self._see_token, 5 * MAX_TOKENS, self._lose_token, keeps_oldest=True)
        self._own_token = session.token(keys.bus_token(self._own.bus, self._own.run, session.zenoh_id))
        watched = [keys.ALL_TOKENS, keys.ALL_BUSES]
        if seen := self._options.groups.seen:
            watched = [keys.buses_with(self._own.bus)]
            watched += [asked(group) for group in seen for asked in (keys.tokens_of, keys.buses_in)]
        self._declared = [session.watch_tokens(expression, tokens) for expression in watched]
        for expression, take in (
            (keys.type_keys(self._own.bus), self._answer_type),
            (keys.kept_keys(self._own.bus), self._answer_kept),
        ):
            asked = session.source(take, _MAX_QUERIES, Query.drop, keeps_oldest=True)
            self._declared.append(session.answer(expression, asked))
        heard = session.source(self._see_ack, _MAX_QUERIES, lambda _: None)
        self._declared.append(
            session.subscribe(
                keys.ack_keys(self._own.bus), lambda key, payload, _: heard.push((str(key), payload))
            )
        )
        self._looking = asyncio.get_running_loop().create_task(self._poll())

    async def close(self) -> None:
        """As `Engine.close`."""
        session, self._session = self._session, None
        if self._looking is not None:
            self._looking.cancel()
        for writer in list(self._writers.values()):
            writer.end()
        for reader in list(self._readers.values()):
            reader.close()
        if session is not None:
            await session.close()
        if self._log is not None:
            self._log.close()

    # --- from this bus to the far side

    def announce_node(self, node: LocalNode) -> None:
        if node.id not in self._nodes:
            self._nodes[node.id] = self._opened().token(keys.node_token(self._own.bus, self._own.run, node))

    def withdraw_node(self, node: LocalNode) -> None:
        token = self._nodes.pop(node.id, None)
        if token is not None:
            token.undeclare()

    def announce_publisher(
        self,
        endpoint: LocalEndpoint,
        schema: MessageSchema,
        rule: RouteRule,
        on_change: Callable[[], None],
    ) -> ZenohWriter:
        """As `Engine.announce_publisher`."""
        if (leaving := self._writers.get(endpoint.gid)) is not None:
            if leaving.come_back(endpoint, rule, on_change):
                return leaving
            leaving.end()
        withdraw = self._announce(endpoint, schema)

        def end() -> None:
            del self._writers[endpoint.gid]
            withdraw()

        writer = ZenohWriter(self._opened(), self._own.bus, endpoint, rule, on_change, end)
        self._writers[endpoint.gid] = writer
        self._see_interests(endpoint.gid)
        return writer

    def announce_subscription(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        """As `Engine.announce_subscription`."""
        return self._announce(endpoint, schema)

    def _announce(self, endpoint: LocalEndpoint, schema: MessageSchema) -> Callable[[], None]:
        kind = (schema.type_name, schema.type_hash)
        encoded, uses = self._schemas.get(kind, (schema.encoded, 0))
        self._schemas[kind] = encoded, uses + 1
        token = self._opened().token(keys.endpoint_token(self._own.bus, self._own.run, endpoint))

        def withdraw() -> None:
            token.undeclare()
            encoded, uses = self._schemas.pop(kind)
            if uses > 1:
                self._schemas[kind] = encoded, uses - 1

        return withdraw

    # --- from the far side to this bus

    async def find_schema(self, endpoint: FarEndpoint) -> MessageSchema:
        """As `Engine.find_schema`."""
        assert self._presence is not None
        bus = self._presence.bus_of(endpoint.node)
        if bus is None:
            raise BridgeError(f"the node of {endpoint.topic} has gone")
        name = endpoint.type_name
        key = keys.type_key(bus, name, endpoint.type_hash)
        for _ in range(_ASK_SCHEMA_TIMES):
            encoded = await self._ask(key, _ASK_SCHEMA_S)
            if encoded is not None:
                return MessageSchema(name, endpoint.type_hash, encoded)
        raise BridgeError(f"bus '{bus}' does not send the definition of {name} on {endpoint.topic}")

    async def _ask(self, key: str, timeout_s: float) -> bytes | None:
        answered: asyncio.Future[bytes | None] = asyncio.get_running_loop().create_future()

        def on_answer(payload: bytes | None, _: bytes | None) -> None:
            if not answered.done():
                answered.set_result(payload)

        self._opened().ask(key, b"", timeout_s, on_answer)
        try:
            async with asyncio.timeout(2 * timeout_s):  # the thread for declarations may be delayed
                return await answered
        except TimeoutError:
            return None

    def read(
        self,
        endpoint: FarEndpoint,
        schema: MessageSchema,
        on_batch: Callable[[Batch], None],
        *,
        restores: bool = False,
    ) -> ZenohReader:
        """As `Engine.read`. Each reader asks for kept messages, whatever `restores` is."""
        assert self._presence is not None
        bus = self._presence.bus_of(endpoint.node)
        if bus is None:
            raise BridgeError(f"the node of {endpoint.topic} has gone")
        place = endpoint.gid, bus
        if place in self._readers:
            raise BridgeError(f"the publisher {endpoint.gid.hex()} on {endpoint.topic} already has a reader")
        reader = ZenohReader(
            self._opened(),
            self._own,
            bus,
            endpoint,
            self._room,
            on_batch,
            lambda reason: self.refuse(bus, reason),
            lambda: self._forget(place),
        )
        self._readers[place] = reader
        return reader

    def _forget(self, place: tuple[bytes, str]) -> None:
        del self._readers[place]

    def refuse(self, bus_id: str, reason: str, announcer: str = "") -> None:
        """As `Engine.refuse`."""
        assert self._presence is not None
        self._presence.refuse(bus_id, reason)
        for (_, bus), reader in list(self._readers.items()):
            if bus == bus_id:
                reader.close()

    def links(self) -> Sequence[LinkStatus]:
        """As `Engine.links`."""
        if self._links is None or self._presence is None:
            return ()
        doubles = [
            (self._own.bus, zenoh_id, "another bus has the id of this one")
            for zenoh_id in self._presence.doubles
        ]
        return self._links.status([*self._presence.buses(), *doubles])

    def refusals(self) -> tuple[int, str]:
        """As `Engine.refusals`."""
        return (0, "") if self._log is None else (self._log.refused, self._log.reason)

    # --- callbacks from zenoh

    def _see_fault(self, error: Exception) -> None:
        assert self._far is not None
        self._far.warn(f"a message from zenoh could not be used: {in_words(error)}")

    def _see_token(self, news: tuple[str, bool]) -> None:
        assert self._presence is not None
        key, is_there = news
        if is_there:
            self._presence.came(key)
        else:
            self._presence.went(key)

    def _lose_token(self, news: tuple[str, bool]) -> None:  # in zenoh's thread
        whose = keys.token_bus(news[0]), keys.token_run(news[0])
        if whose not in self._crowd and len(self._crowd) < 1000 and self._session is not None:
            self._crowd.add(whose)
            self._session.call(self._refuse_crowd, *whose)

    def _refuse_crowd(self, bus: str, run: str) -> None:
        assert self._presence is not None
        self._presence.refuse(bus, "it shows more tokens at once than can be read", run)

    def _see_interests(self, gid: bytes) -> None:
        assert self._presence is not None
        writer = self._writers.get(gid)
        if writer is not None:
            writer.see_interests(self._presence.interests(gid))

    def _see_ack(self, ack: tuple[str, bytes]) -> None:
        found, said = keys.parse_importer(ack[0]), records.read_pair(ack[1])
        if found is not None and said is not None and found[0] in self._writers:
            self._writers[found[0]].see_ack(found[1], *said)

    def _answer_kept(self, query: Query) -> None:
        found = keys.parse_importer(query.key)
        if found is None or found[0] not in self._writers:
            query.drop()
        else:
            self._writers[found[0]].reply(query, found[1])

    def _answer_type(self, query: Query) -> None:
        kind = keys.parse_type(query.key)
        known = None if kind is None else self._schemas.get(kind)
        if known is None:
            query.drop()
        else:
            query.reply(known[0])

    async def _poll(self) -> None:
        assert self._links is not None and self._session is not None
        assert self._presence is not None and self._far is not None
        heard = seen = self._session.link_ends
        while True:
            await asyncio.sleep(_LOOK_S)
            try:
                # If a link ends just after the start of another link to the same bus, zenoh may no longer
                # report tokens of that bus. So ask for all tokens again after a check without an ended link.
                # Do not do so for new links: in a fleet, each new link would fetch the tokens of all other
                # buses again.
                seen, before = self._session.link_ends, seen
                if heard != seen == before:
                    heard = seen
                    for declared in self._declared:
                        declared.renew()
                for writer in list(self._writers.values()):
                    writer.poll()
                links = self._session.links()
                is_routed = bool(self._options.router)
                self._presence.poll(
                    None if is_routed else {link.zenoh_id: link.silent_host for link in links}
                )
                await self._links.check()
            except Exception as error:  # the next round may do better
                self._far.warn(f"a check of the links failed: {in_words(error)}")

    def _opened(self) -> Session:
        if self._session is None:
            raise BridgeError("the engine for zenoh is not open")
        return self._session
