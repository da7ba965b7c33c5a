"""Topics of the bus as channels of a client, and the formats of their messages."""

from collections.abc import Mapping
from typing import Any

from bus.names import is_hidden_topic
from bus_ros.cdr import Codec
from bus_web.foxglove import protocol
from bus_web.foxglove.advertised import Advertised
from bus_web.foxglove.client import Client
from bus_web.foxglove.formats import Formats, describe_channel
from bus_web.foxglove.protocol import Level
from bus_web.shared_subscriptions import TypeKind

__all__ = ["Channels"]

_PORTION = 256 << 10
"""Bytes of descriptions that are sent at once."""


class Channels:
    """The channels that one client knows."""

    def __init__(self, formats: Formats, client: Client) -> None:
        self._formats = formats
        self._client = client
        self._advertised: Advertised[TypeKind, Codec] = Advertised()
        self._present: Mapping[str, TypeKind] = {}
        self._left_out: set[str] = set()

    def topic_of(self, id: int) -> str | None:
        """None if there is no such channel."""
        return self._advertised.name_of(id)

    def codec_of(self, topic: str, kind: TypeKind) -> Codec | None:
        """The codec of the topic's channel; None if there is none, or it has another type."""
        known = self._advertised.entries.get(topic)
        return known.format if known is not None and known.kind == kind else None

    def update(self, kinds: Mapping[str, TypeKind], *, keep: bool) -> list[str]:
        """`kinds`: the types of present topics. `keep`: only channels with another type are removed.

        Tells the client which channels have gone; returns their topics.
        """
        present = {topic: kind for topic, kind in kinds.items() if not is_hidden_topic(topic)}
        if keep:
            present = {topic: one.kind for topic, one in self._advertised.entries.items()} | present
        self._present = present
        gone = self._advertised.gone(present)
        if gone:
            ids = [self._advertised.remove(topic) for topic in gone]
            self._client.notify(protocol.text("unadvertise", channelIds=ids))
        return gone

    async def advertise_new(self) -> None:
        """Advertise channels new to the client in portions, each after it has read the one before."""
        present = self._present
        told: list[Mapping[str, Any]] = []
        size = 0
        for topic in self._advertised.missing(present):
            codec = await self._formats.find(present[topic])
            if not isinstance(codec, Codec):
                self._leave_out(topic, codec)
                continue
            told.append(describe_channel(self._advertised.add(topic, present[topic], codec), topic, codec))
            size += len(codec.definition)
            if size > _PORTION:
                self._client.notify(protocol.text("advertise", channels=told))
                told, size = [], 0
                await self._client.drain()
        if told:
            self._client.notify(protocol.text("advertise", channels=told))

    def _leave_out(self, topic: str, reason: str | None) -> None:
        if reason is not None and topic not in self._left_out:
            self._left_out.add(topic)
            self._client.say(Level.WARNING, f"{topic} is left out: {reason}", f"left out {topic}")
