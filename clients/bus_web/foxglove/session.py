"""One client of Foxglove's protocol: what it is told, what it looks at, and what it may do besides."""

import asyncio
from collections import Counter
from collections.abc import Coroutine, Mapping
from contextlib import suppress
from typing import Any, Protocol

import msgspec

from bus.base.version import RELEASE
from bus.errors import BusError
from bus.names import is_hidden_topic
from bus_ros.cdr import CdrError, Codec
from bus_web.foxglove import protocol
from bus_web.foxglove.calls import Calls
from bus_web.foxglove.channels import Channels, ConnectionGraph, Described, Kind
from bus_web.foxglove.formats import Formats
from bus_web.foxglove.parameters import EVENTS, Parameters
from bus_web.foxglove.protocol import Level, Said
from bus_web.foxglove.publishing import Publishing
from bus_web.hub import Hub, Watcher
from bus_web.outbox import Outbox
from bus_web.taps import Heard

__all__ = ["Permissions", "Session", "Socket"]

CLOCK, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"
_MOST_SUBSCRIPTIONS = 4096
_MOST_TASKS = 64
"""Calls and questions for parameters of one client that may be under way."""
_MOST_NOTICES = 64
"""Answers that wait for a client; while there are more, nothing is read of it."""
_PORTION = 256 << 10
"""Bytes of channels that are told at once."""
_RETURN_S = 5.0
"""Channels stay so long after busd was away: programs come back one by one."""
_TOO_MANY = "there are too many questions under way"
_TIME = "time"
"""Stands for a topic in the outbox; no topic is called so."""


class Permissions(msgspec.Struct, frozen=True, kw_only=True):
    """What a client may do besides looking."""

    publish: bool = False
    call: bool = False
    set: bool = False


class Socket(Protocol):
    """A WebSocket, as far as it is used here."""

    async def send(self, message: bytes, *, text: bool) -> None: ...

    async def recv(self) -> str | bytes: ...


class Session(Watcher):
    """Speaks with the client at `socket` until that ends (`run`).

    `id` is the server's: a client that comes back to the same one goes on as it was.
    """

    def __init__(
        self, hub: Hub, formats: Formats, socket: Socket, bus: str, id: str, permissions: Permissions
    ) -> None:
        self._hub = hub
        self._formats = formats
        self._socket = socket
        self._bus = bus
        self._id = id
        self._may = permissions
        self._loop = asyncio.get_running_loop()
        self._outbox = Outbox()
        self._ready, self._is_read, self._news = asyncio.Event(), asyncio.Event(), asyncio.Event()
        self._is_read.set()
        self._has_looked = asyncio.Event()
        """Since it came: what was seen of the bus before may be long ago."""
        self._channels = Channels()
        self._codecs: dict[str, tuple[Kind, Codec]] = {}
        self._left_out: set[str] = set()
        self._subscriptions: dict[int, str] = {}
        self._numbers: dict[str, int] = {}
        self._looks: dict[str, set[str]] = {}
        self._connections: ConnectionGraph | None = None
        self._has_clock = False
        self._clock_ns = 0
        self._is_lost = False
        self._keep_until_s = 0.0
        self._missed: Counter[str] = Counter()
        self._tasks: set[asyncio.Task[None]] = set()
        self._parameters = Parameters(hub, self)
        self._publishing = Publishing(hub, self) if permissions.publish else None
        self._calls = Calls(hub, formats, self, may_set=permissions.set) if permissions.call else None

    async def run(self) -> None:
        """Raises what the socket raises when it ends."""
        self._introduce()
        tasks: list[asyncio.Task[None]] = []
        try:
            async with self._hub.watching(self):
                if self._hub.is_lost:
                    self.lost("busd does not answer")
                elif self._hub.has_looked:
                    self._news.set()
                tasks = [self._loop.create_task(one) for one in (self._send(), self._tell(), self._listen())]
                done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                for task in done:
                    task.result()
        finally:
            for task in (*tasks, *self._tasks):
                task.cancel()
            await asyncio.gather(*tasks, *self._tasks, return_exceptions=True)
            for topic in [*self._looks]:
                self._looks.pop(topic)
                self._hub.taps.remove(topic, self)
            for part in (self._publishing, self._calls):
                if part is not None:
                    with suppress(BusError):
                        await part.close()

    def _introduce(self) -> None:
        """Say who serves and what can be had; once more, where a clock has come or gone."""
        may_be = {
            "connectionGraph": True,
            "parameters": True,
            "parametersSubscribe": True,
            "time": self._has_clock,
            "clientPublish": self._may.publish,
            "services": self._may.call,
        }
        self._notify(
            "serverInfo",
            name=f"busd {RELEASE}, {self._bus}",
            capabilities=[name for name, is_there in may_be.items() if is_there],
            supportedEncodings=["cdr"],
            metadata={"ROS_DISTRO": "jazzy"},
            sessionId=self._id,
        )

    # --- of the hub

    def looked(self, *, is_new: bool) -> None:
        if self._is_lost:
            self._is_lost = False
            self._keep_until_s = self._loop.time() + _RETURN_S
            self.put(protocol.text("removeStatus", statusIds=["bus"]))
        self._has_looked.set()
        self._news.set()

    def lost(self, text: str) -> None:
        self._is_lost = True
        self.say(Level.WARNING, f"the bus is away: {text}", "bus")

    # --- of the taps

    def hear(self, topic: str, heard: Heard) -> None:
        if topic == CLOCK and self._has_clock:
            self._hear_clock(heard)
        if topic == EVENTS and self._parameters.is_following and self._outbox.notices < _MOST_NOTICES:
            self._parameters.hear(heard)
        number = self._numbers.get(topic)
        kind, codec = self._codecs.get(topic, (None, None))
        if number is None or codec is None or kind != (heard.schema.type_name, heard.schema.type_hash):
            return
        parts = heard.frames.get("cdr")  # for all clients
        if parts is None:
            try:
                parts = codec.encode(heard.payload)
            except CdrError as error:
                self.hear_fault(topic, str(error))
                return
            heard.frames["cdr"] = parts
        time_ns = self._clock_ns if self._has_clock else heard.info.received_timestamp
        self._outbox.put(topic, protocol.message(number, time_ns, parts))
        self._ready.set()

    def hear_fault(self, topic: str, text: str) -> None:
        if self._outbox.notices < _MOST_NOTICES:
            self.say(Level.WARNING, f"{topic}: {text}", f"fault {topic}")

    def _hear_clock(self, heard: Heard) -> None:
        try:
            stamp = heard.message.clock
            self._clock_ns = max(0, stamp.sec) * 1_000_000_000 + stamp.nanosec
        except Exception:  # bytes of a stranger
            return
        self._outbox.forget(_TIME)  # only the newest is of interest
        self._outbox.put(_TIME, protocol.time(self._clock_ns))
        self._ready.set()

    # --- what the client is told

    async def _tell(self) -> None:
        """The graph, whenever that is new; in portions, each when the one before has been read."""
        while True:
            await self._news.wait()
            await self._is_read.wait()
            self._news.clear()
            if self._is_lost or not self._hub.has_looked:
                continue
            self._follow_clock()
            await self._tell_channels()
            if self._calls is not None and self._loop.time() >= self._keep_until_s:
                await self._calls.tell(self._hub.model.graph)
            self._tell_connections()
            self._tell_missed()

    def _follow_clock(self) -> None:
        graph = self._hub.model.graph
        has_clock = any(one.type_name == CLOCK_TYPE for one in graph.publishers_of(CLOCK))
        if has_clock == self._has_clock or (not has_clock and self._loop.time() < self._keep_until_s):
            return
        self._has_clock = has_clock
        if has_clock:
            self._introduce()
            self._look_at(CLOCK, "time")
        else:
            self._look_away(CLOCK, "time")
            self._introduce()

    async def _tell_channels(self) -> None:
        kinds = {topic: kind for topic, kind in self._hub.taps.kinds.items() if not is_hidden_topic(topic)}
        if self._loop.time() < self._keep_until_s:
            kinds = {**{topic: kind for topic, (kind, _) in self._codecs.items()}, **kinds}
        for topic in [topic for topic, (kind, _) in self._codecs.items() if kinds.get(topic) != kind]:
            self._unsubscribe(topic)
            del self._codecs[topic]
        if gone := self._channels.gone(kinds):
            self._notify("unadvertise", channelIds=gone)
        told: list[Mapping[str, Any]] = []
        size = 0
        for topic in self._channels.missing(kinds):
            codec = await self._formats.find(kinds[topic])
            if not isinstance(codec, Codec):
                self._leave_out(topic, codec)
                continue
            self._codecs[topic] = kinds[topic], codec
            told.append(
                self._channels.tell(topic, kinds[topic], Described(codec.type_name, codec.definition))
            )
            size += len(codec.definition)
            if size > _PORTION:
                self._notify("advertise", channels=told)
                told, size = [], 0
                await self._is_read.wait()
        if told:
            self._notify("advertise", channels=told)

    def _leave_out(self, topic: str, reason: str | None) -> None:
        if reason is not None and topic not in self._left_out:
            self._left_out.add(topic)
            self.say(Level.WARNING, f"{topic} is left out: {reason}", f"left out {topic}")

    def _tell_connections(self) -> None:
        if self._connections is None:
            return
        news = self._connections.update(self._hub.model.graph)
        if news is not None:
            self._notify("connectionGraphUpdate", **news)

    def _tell_missed(self) -> None:
        """How many messages went because the client reads too slowly."""
        if not self._outbox.dropped:
            return
        self._missed.update(self._outbox.dropped)
        self._outbox.dropped.clear()
        worst = ", ".join(f"{topic} {number}" for topic, number in self._missed.most_common(5))
        total = self._missed.total()
        self.say(
            Level.WARNING, f"{total} messages left out, because this client reads too slowly: {worst}", "slow"
        )

    # --- what the client says

    async def _listen(self) -> None:
        while True:
            if self._outbox.notices > _MOST_NOTICES:
                await self._is_read.wait()
            frame = await self._socket.recv()
            try:
                said = protocol.read(frame)
            except protocol.Misunderstood as error:
                self.say(Level.ERROR, str(error))
                continue
            await self._answer(said)

    async def _answer(self, said: Said) -> None:
        match said:
            case protocol.Subscribe():
                self._subscribe(said)
            case protocol.Unsubscribe():
                for id in said.subscription_ids:
                    with suppress(KeyError):
                        self._unsubscribe(self._subscriptions[id])
            case protocol.SubscribeConnectionGraph():
                self._connections = self._connections or ConnectionGraph()
                self._news.set()
            case protocol.UnsubscribeConnectionGraph():
                self._connections = None
            case protocol.FetchAsset():
                self.put(protocol.asset_missing(said.request_id, "files are not served here"))
            case protocol.GetParameters():
                self._begin(self._get_parameters(said), _TOO_MANY)
            case protocol.SetParameters():
                self._set_parameters(said)
            case protocol.SubscribeParameterUpdates():
                self._parameters.follow(said.names)
                self._look_at(EVENTS, "parameters")
            case protocol.UnsubscribeParameterUpdates():
                self._parameters.unfollow(said.names)
                if not self._parameters.is_following:
                    self._look_away(EVENTS, "parameters")
            case protocol.Call():
                self._call(said)
            case _:
                await self._publish(said)

    async def _publish(self, said: protocol.Advertise | protocol.Unadvertise | protocol.Publish) -> None:
        if self._publishing is None:
            self._refuse("publish", "--allow-publish")
        elif isinstance(said, protocol.Advertise):
            await self._publishing.advertise(said.channels)
        elif isinstance(said, protocol.Unadvertise):
            await self._publishing.unadvertise(said.channel_ids)
        else:
            self._publishing.publish(said)

    def _set_parameters(self, said: protocol.SetParameters) -> None:
        if self._may.set:
            self._begin(self._change_parameters(said), _TOO_MANY)
            return
        self._refuse("set parameters", "--allow-set")
        if said.id is not None and (names := [one.name for one in said.parameters]):
            question = protocol.GetParameters(names, said.id)  # they are as they were
            self._begin(self._get_parameters(question), _TOO_MANY)

    async def _change_parameters(self, said: protocol.SetParameters) -> None:
        await self._has_looked.wait()
        await self._parameters.set(said)

    async def _get_parameters(self, said: protocol.GetParameters) -> None:
        """Viewers ask as soon as they are there."""
        await self._has_looked.wait()
        await self._parameters.get(said)

    def _call(self, said: protocol.Call) -> None:
        if self._calls is None:
            text = "nobody may call services here: bus web was started without --allow-call"
            self.put(protocol.call_failure(said, text))
            self.say(Level.ERROR, text)
        elif not self._begin(self._calls.call(said)):
            self.put(protocol.call_failure(said, f"{_MOST_TASKS} calls are under way already"))

    def _begin(self, work: Coroutine[Any, Any, None], refusal: str = "") -> bool:
        """Do it beside all else; returns whether there is room for that."""
        if len(self._tasks) >= _MOST_TASKS:
            work.close()
            if refusal:
                self.say(Level.ERROR, refusal)
            return False
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return True

    def _refuse(self, what: str, option: str) -> None:
        self.say(Level.ERROR, f"nobody may {what} here: bus web was started without {option}")

    def _subscribe(self, said: protocol.Subscribe) -> None:
        faults: list[str] = []
        for one in said.subscriptions:
            topic = self._channels.name_of(one.channel_id)
            if topic is None:
                faults.append(f"there is no channel {one.channel_id}")
            elif one.id in self._subscriptions:
                faults.append(f"there is a subscription {one.id} already")
            elif topic in self._numbers:
                faults.append(f"channel {one.channel_id} is subscribed to already")
            elif len(self._subscriptions) >= _MOST_SUBSCRIPTIONS:
                faults.append(f"{_MOST_SUBSCRIPTIONS} subscriptions are the most")
            else:
                self._subscriptions[one.id] = topic
                self._numbers[topic] = one.id
                self._look_at(topic, "messages")
        if faults:
            more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
            self.say(Level.WARNING, f"{faults[0]}{more}")

    def _unsubscribe(self, topic: str) -> None:
        number = self._numbers.pop(topic, None)
        if number is not None:
            del self._subscriptions[number]
            self._look_away(topic, "messages")
            self._outbox.forget(topic)

    def _look_at(self, topic: str, why: str) -> None:
        reasons = self._looks.setdefault(topic, set())
        reasons.add(why)
        if len(reasons) == 1:
            self._hub.taps.add(topic, self, is_last_wanted=False)

    def _look_away(self, topic: str, why: str) -> None:
        reasons = self._looks.get(topic, set())
        reasons.discard(why)
        if not reasons and self._looks.pop(topic, None) is not None:
            self._hub.taps.remove(topic, self)

    # --- to the client

    def say(self, level: Level, text: str, id: str | None = None) -> None:
        """A status. Of one `id` the last holds."""
        self.put(protocol.status(level, text, id))

    def _notify(self, op: str, **fields: Any) -> None:
        self.put(protocol.text(op, **fields))

    def put(self, frame: bytes) -> None:
        """A frame that is of no topic."""
        self._outbox.notify(frame)
        self._is_read.clear()
        self._ready.set()

    async def _send(self) -> None:
        while True:
            frame = self._outbox.take()
            if frame is None:
                self._ready.clear()
                await self._ready.wait()
                continue
            await self._socket.send(frame, text=protocol.is_text(frame))
            if not self._outbox.notices:
                self._is_read.set()
