"""A client's own channels, each with a publisher."""

from collections.abc import Iterable
from typing import Any

from bus.errors import BusError, ConfigurationError
from bus.graph import types_of
from bus.names import service_of_topic
from bus.publisher import Publisher
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_ros.cdr import Codec, codec_of, schema_of_definition
from bus_web.foxglove import protocol
from bus_web.foxglove.client import Client
from bus_web.foxglove.protocol import ClientChannel, Level, Publish
from bus_web.hub import Hub

__all__ = ["Publishing"]

_MOST_CHANNELS = 256
_MOST_DEFINITION = 256 << 10
"""Characters of a type's definition: reading a long one delays all other clients."""
_DEPTH = 10


class Publishing:
    """The channels of one client; `close` them in the end."""

    def __init__(self, hub: Hub, client: Client) -> None:
        self._hub = hub
        self._client = client
        self._channels: dict[int, tuple[Publisher[Any], Codec]] = {}

    async def advertise(self, channels: Iterable[ClientChannel]) -> None:
        """The client is about to publish; it is told of channels that are not possible."""
        faults = []
        for one in channels:
            try:
                self._check(one)
                schema = await self._schema(one)
                codec = codec_of(schema)
                publisher = await self._hub.node.create_publisher(schema, one.topic, _DEPTH)
            except (BusError, TimeoutError) as error:
                faults.append(f"channel {one.id} ({one.topic}): {error}")
            else:
                self._channels[one.id] = publisher, codec
        if faults:
            self._client.say(Level.ERROR, protocol.first_of(faults))

    async def unadvertise(self, ids: Iterable[int]) -> None:
        """The client no longer publishes on these."""
        for id in ids:
            if (known := self._channels.pop(id, None)) is not None:
                await known[0].close()

    def publish(self, said: Publish) -> None:
        """A message; the client is told why it can't be published."""
        known = self._channels.get(said.channel_id)
        if known is None:
            text = f"there is no channel {said.channel_id} to publish on: advertise it first"
            self._client.say(Level.ERROR, text, f"publish {said.channel_id}")
            return
        publisher, codec = known
        try:
            publisher.publish_encoded(codec.decode(said.data))
        except BusError as error:
            self._client.say(Level.ERROR, f"{publisher.topic_name}: {error}", f"publish {said.channel_id}")

    async def close(self) -> None:
        """End all of them."""
        await self.unadvertise([*self._channels])

    def _check(self, one: ClientChannel) -> None:
        if one.id in self._channels:
            raise ConfigurationError("there is a channel of this number already")
        if len(self._channels) >= _MOST_CHANNELS:
            raise ConfigurationError(f"a client can have at most {_MOST_CHANNELS} channels")
        if one.encoding != "cdr":
            raise ConfigurationError(f"messages must be in cdr, not in {one.encoding!r:.40}")
        if service_of_topic(one.topic) is not None:
            raise ConfigurationError("a service is called, not published to")

    async def _schema(self, one: ClientChannel) -> MessageSchema:
        """The type as it is on the bus; else as it is known here; else as the client describes it.

        Raises BusError if there is none.
        """
        parts = one.schema_name.split("/")
        name = f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else one.schema_name
        if self._hub.has_looked:
            present = self._hub.subscriptions.kinds.get(one.topic)
            if present is not None and present[0] != name:
                raise ConfigurationError(f"the topic has the type {present[0]}, not {name}")
            for kind in types_of(self._hub.model.graph, one.topic, name):
                return await self._hub.node.get_schema(*kind)
        try:
            return MessageSchema.of(message_class(name))
        except ConfigurationError:
            if not one.schema or one.schema_encoding not in (None, "ros2msg"):
                raise
            if (size := len(one.schema)) > _MOST_DEFINITION:
                raise ConfigurationError(
                    f"its definition has {size} characters; the limit is {_MOST_DEFINITION}"
                ) from None
            return schema_of_definition(name, one.schema)
