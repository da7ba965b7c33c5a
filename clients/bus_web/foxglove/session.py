"""One client of Foxglove's protocol: its frames, the topics that it views, and its other permissions."""

import asyncio
from collections import Counter
from collections.abc import Coroutine, Mapping
from contextlib import suppress
from typing import Any

import msgspec

from bus.base.counted import counted
from bus.base.together import until_one_ends
from bus.base.version import RELEASE
from bus.errors import BusError
from bus_ros.cdr import CdrError
from bus_web.foxglove import protocol
from bus_web.foxglove.assets import Assets
from bus_web.foxglove.calls import Calls
from bus_web.foxglove.channels import Channels
from bus_web.foxglove.client import Client
from bus_web.foxglove.clock import CLOCK, Clock
from bus_web.foxglove.connections import ConnectionGraph
from bus_web.foxglove.formats import Formats
from bus_web.foxglove.looks import Looks
from bus_web.foxglove.parameters import EVENTS, Parameters
from bus_web.foxglove.playing import Playing
from bus_web.foxglove.protocol import Level, Said
from bus_web.foxglove.publishing import Publishing
from bus_web.foxglove.subscriptions import Subscriptions
from bus_web.foxglove.tasks import Tasks
from bus_web.hub import Hub, Watcher
from bus_web.outbox import Outbox
from bus_web.playback import Playback
from bus_web.sender import Socket
from bus_web.shared_subscriptions import Heard

__all__ = ["Permissions", "Session"]

_RETURN_S = 5.0
"""Channels stay so long after busd was away: programs come back one by one."""
_TOO_MANY = "too many calls and questions are under way"
_TIME = "time"
"""Stands for a topic in the outbox; no topic is called so."""


class Permissions(msgspec.Struct, frozen=True, kw_only=True):
    """What a client may do besides looking."""

    publish: bool = False
    call: bool = False
    set: bool = False


class ServerInfo(msgspec.Struct, frozen=True, kw_only=True):
    """The server, as announced to its clients."""

    bus: str
    id: str
    permissions: Permissions

    def told(self, *, has_clock: bool, playback: Mapping[str, Any] | None = None) -> bytes:
        """The message, with the capabilities; `playback`: fields about a recording, if one is played."""
        may_be = {
            "connectionGraph": True,
            "parameters": True,
            "parametersSubscribe": True,
            "time": has_clock or playback is not None,
            "playbackControl": playback is not None,
            "assets": True,
            "clientPublish": self.permissions.publish,
            "services": self.permissions.call,
        }
        return protocol.text(
            "serverInfo",
            name=f"busd {RELEASE}, {self.bus}",
            capabilities=[name for name, is_there in may_be.items() if is_there],
            supportedEncodings=["cdr"],
            metadata={"ROS_DISTRO": "jazzy"},
            sessionId=self.id,
            **(playback or {}),
        )


class Absence:
    """Whether busd is away, and whether it has only just come back."""

    def __init__(self) -> None:
        self.is_on = False
        self._settled_s = 0.0

    def begin(self) -> None:
        self.is_on = True

    def end(self, now_s: float) -> bool:
        """busd answers. Returns whether it did not before."""
        was_on, self.is_on = self.is_on, False
        if was_on:
            self._settled_s = now_s + _RETURN_S
        return was_on

    def was_recent(self, now_s: float) -> bool:
        """Whether programs may still be on their way back."""
        return now_s < self._settled_s


class Session(Watcher):
    """Speaks with the client at `socket` until that ends (`run`).

    `id` identifies the server: a client that reconnects to the same server continues. The client controls the
    `playback`, if there is one.
    """

    def __init__(
        self,
        hub: Hub,
        formats: Formats,
        socket: Socket,
        bus: str,
        id: str,
        permissions: Permissions,
        playback: Playback | None = None,
    ) -> None:
        self._hub = hub
        self._socket = socket
        self._server = ServerInfo(bus=bus, id=id, permissions=permissions)
        self._introduced = b""
        """The last message about the server."""
        self._loop = asyncio.get_running_loop()
        self._client = client = Client(socket, Outbox(shared=hub.waiting))
        self._news = asyncio.Event()
        self._has_looked = asyncio.Event()
        """Set by the first look since the client came: an earlier look may be old."""
        self._absence = Absence()
        self._channels = Channels(formats, client)
        self._subscriptions = Subscriptions()
        self._looks = Looks(hub.subscriptions, self)
        self._clock = Clock()
        self._connections: ConnectionGraph | None = None
        self._parameters = Parameters(hub, client)
        self._assets = Assets(client)
        self._playing = Playing(playback, client) if playback is not None else None
        self._publishing = Publishing(hub, client) if permissions.publish else None
        self._calls = Calls(hub, formats, client, may_set=permissions.set) if permissions.call else None
        self._missed: Counter[str] = Counter()
        self._tasks = Tasks()

    async def run(self) -> None:
        """Raises the socket's exception when it ends."""
        self._introduce()
        if self._playing is not None:
            self._playing.begin()
        try:
            async with self._hub.watching(self):
                if self._hub.is_lost:
                    self.lost("busd does not answer")
                elif self._hub.has_looked:
                    self._news.set()
                await until_one_ends(self._client.run(), self._advertise(), self._listen())
        finally:
            await self._tasks.cancel()
            self._looks.close()
            if self._playing is not None:
                self._playing.close()
            self._client.close()
            for part in (self._publishing, self._calls):
                if part is not None:
                    with suppress(BusError):
                        await part.close()

    def _introduce(self) -> None:
        """Send the server's name and capabilities, if they are new: a clock may have come or gone."""
        playback = self._playing.server_info() if self._playing is not None else None
        told = self._server.told(has_clock=self._clock.is_there, playback=playback)
        if told != self._introduced:
            self._introduced = told
            self._client.notify(told)

    # --- of the hub

    def looked(self, *, is_new: bool) -> None:
        if self._absence.end(self._loop.time()):
            self._client.remove_status("bus")
        self._has_looked.set()
        self._news.set()

    def lost(self, text: str) -> None:
        self._absence.begin()
        self._client.say(Level.WARNING, f"the bus is away: {text}", "bus")

    # --- of the subscriptions

    def on_message(self, topic: str, heard: Heard) -> None:
        if topic == CLOCK and self._clock.is_there and self._clock.update(heard):
            self._client.forget(_TIME)  # only the newest is of interest
            self._client.put(_TIME, protocol.time(self._clock.now_ns))
        if topic == EVENTS and self._parameters.is_following and not self._client.is_behind:
            self._parameters.on_event(heard)
        id = self._subscriptions.id_of(topic)
        codec = self._channels.codec_of(topic, (heard.schema.type_name, heard.schema.type_hash))
        if id is None or codec is None:
            return
        parts = heard.frames.get("cdr")  # for all clients
        if parts is None:
            try:
                parts = heard.frames["cdr"] = codec.encode(heard.payload)
            except CdrError as error:
                self.on_fault(topic, str(error))
                return
        self._client.put(topic, protocol.message(id, self._time_of(heard), parts))

    def _time_of(self, heard: Heard) -> int:
        if self._playing is not None:
            return self._playing.now_ns
        return self._clock.now_ns if self._clock.is_there else heard.info.received_timestamp

    def on_fault(self, topic: str, text: str) -> None:
        if not self._client.is_behind:
            self._client.say(Level.WARNING, f"{topic}: {text}", f"fault {topic}")

    # --- to the client

    async def _advertise(self) -> None:
        """Send the graph whenever it is new and the client has read the frames before."""
        while True:
            await self._news.wait()
            await self._client.drain()
            self._news.clear()
            if self._playing is not None:
                self._playing.follow()
            if self._absence.is_on or not self._hub.has_looked:
                continue
            graph = self._hub.model.graph
            is_back = self._absence.was_recent(self._loop.time())
            if self._clock.follow(graph, keep=is_back):
                self._introduce()
                if self._clock.is_there:
                    self._looks.add(CLOCK, "time")
                else:
                    self._looks.remove(CLOCK, "time")
            for topic in self._channels.update(self._hub.subscriptions.kinds, keep=is_back):
                self._unsubscribe(topic)
            await self._channels.advertise_new()
            if self._calls is not None and not is_back:
                await self._calls.advertise(self._hub.model.graph)
            self._send_connections()
            self._report_missed()

    def _send_connections(self) -> None:
        if self._connections is None:
            return
        news = self._connections.update(self._hub.model.graph)
        if news is not None:
            self._client.notify(protocol.text("connectionGraphUpdate", **news))

    def _report_missed(self) -> None:
        """Report the number of messages dropped because the client reads too slowly."""
        dropped = self._client.take_dropped()
        if not dropped:
            return
        self._missed.update(dropped)
        worst = ", ".join(f"{topic} {number}" for topic, number in self._missed.most_common(5))
        total = self._missed.total()
        self._client.say(
            Level.WARNING,
            f"{counted(total, 'message')} left out, because this client reads too slowly: {worst}",
            "slow",
        )

    # --- from the client

    async def _listen(self) -> None:
        while True:
            if self._client.is_behind:
                await self._client.drain()
            frame = await self._socket.recv()
            try:
                said = protocol.read(frame)
            except protocol.Misunderstood as error:
                self._client.say(Level.ERROR, str(error))
                continue
            await self._answer(said)

    async def _answer(self, said: Said) -> None:
        match said:
            case protocol.Subscribe():
                self._subscribe(said)
            case protocol.Unsubscribe():
                for id in said.subscription_ids:
                    if (topic := self._subscriptions.topic_of(id)) is not None:
                        self._unsubscribe(topic)
            case protocol.SubscribeConnectionGraph():
                self._connections = self._connections or ConnectionGraph()
                self._news.set()
            case protocol.UnsubscribeConnectionGraph():
                self._connections = None
            case protocol.FetchAsset():
                if not self._begin(self._assets.fetch(said)):
                    self._client.notify(protocol.asset_missing(said.request_id, _TOO_MANY))
            case protocol.GetParameters():
                self._begin(self._get_parameters(said), _TOO_MANY)
            case protocol.SetParameters():
                self._set_parameters(said)
            case protocol.SubscribeParameterUpdates():
                self._parameters.follow(said.names)
                self._looks.add(EVENTS, "parameters")
            case protocol.UnsubscribeParameterUpdates():
                self._parameters.unfollow(said.names)
                if not self._parameters.is_following:
                    self._looks.remove(EVENTS, "parameters")
            case protocol.Call():
                self._call(said)
            case protocol.PlaybackRequest():
                self._play(said)
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
        if self._server.permissions.set:
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
            text = "no permission to call services: start bus web with --allow-call"
            self._client.notify(protocol.call_failure(said, text))
            self._client.say(Level.ERROR, text)
        elif not self._begin(self._calls.call(said), size=len(said.data)):
            self._client.notify(protocol.call_failure(said, _TOO_MANY))

    def _play(self, said: protocol.PlaybackRequest) -> None:
        if self._playing is None:
            self._client.say(Level.ERROR, "nothing is played here: start bus web with --bag")
        elif not self._begin(self._playing.ask(said), _TOO_MANY):
            self._playing.answer(said)

    def _begin(self, work: Coroutine[Any, Any, None], refusal: str = "", *, size: int = 0) -> bool:
        """Run `work` concurrently; returns whether there is room. `size`: bytes that it keeps."""
        has_begun = self._tasks.begin(work, size)
        if not has_begun and refusal:
            self._client.say(Level.ERROR, refusal)
        return has_begun

    def _refuse(self, what: str, option: str) -> None:
        self._client.say(Level.ERROR, f"no permission to {what}: start bus web with {option}")

    def _subscribe(self, said: protocol.Subscribe) -> None:
        faults: list[str] = []
        for one in said.subscriptions:
            topic = self._channels.topic_of(one.channel_id)
            if topic is None:
                faults.append(f"there is no channel {one.channel_id}")
            elif fault := self._subscriptions.add(one.id, topic):
                faults.append(fault)
            else:
                self._looks.add(topic, "messages")
        if faults:
            self._client.say(Level.WARNING, protocol.first_of(faults))

    def _unsubscribe(self, topic: str) -> None:
        if self._subscriptions.remove(topic):
            self._looks.remove(topic, "messages")
            self._client.forget(topic)
