"""Recordings in tests: `bus bag record` as a process, publishers for it, and the content of its bag."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

pytest.importorskip("mcap")  # for all modules that import this

from bus.msg.std_msgs import String
from bus.schema import MessageSchema
from bus_bag.errors import BagError
from bus_bag.losses import RECORD, TopicLosses, from_record
from bus_bag.metadata import BagMetadata, from_yaml
from bus_bag.storage import open_bag
from bus_ros.cdr import codec_of
from cli import Result, Running, script, start

__all__ = ["Bag", "Speaker", "end", "recording", "speaking"]

SPEAKER = """
import asyncio, contextlib, sys, bus
from bus.msg.std_msgs import String
async def main():
    publishers = {}
    async with bus.Node(sys.argv[1]) as node:
        print("ready", flush=True)
        while line := await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline):
            topic, durability, *texts = line.split()
            if topic not in publishers:
                profile = bus.QoSProfile(
                    int(sys.argv[2]) if durability == "volatile" else 1, durability=durability
                )
                publishers[topic] = await node.create_publisher(String, topic, profile)
            with contextlib.suppress(TimeoutError):  # where there is no busd
                async with asyncio.timeout(1):
                    await node.graph()  # before its answer, busd has told of all subscriptions that are there
            for text in texts:
                publishers[topic].publish(String(data=text))
            print("said", flush=True)
bus.run(main())
"""


class Speaker:
    """A program that publishes texts; a call returns after the bus has them."""

    def __init__(self, running: Running) -> None:
        self._running = running

    def say(self, topic: str, *texts: object) -> None:
        self._speak(topic, "volatile", *texts)

    def keep(self, topic: str, *texts: object) -> None:
        """Publish as a transient local publisher with depth one."""
        self._speak(topic, "transient_local", *texts)

    def _speak(self, *words: object) -> None:
        self._running.write(" ".join(map(str, words)) + "\n")
        assert self._running.line() == "said"


class Bag:
    """A recorded bag, as other programs' readers see it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def metadata(self) -> BagMetadata:
        return from_yaml((self.folder / "metadata.yaml").read_text())

    @property
    def files(self) -> list[Path]:
        """The files in order."""
        return sorted(self.folder.glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2]))

    def texts(self, topic: str = "/topic") -> list[str]:
        """The texts of a topic, as rosbags reads the whole bag."""
        from rosbags.highlevel import AnyReader

        with AnyReader([self.folder]) as reader:
            messages: list[Any] = [
                reader.deserialize(raw, connection.msgtype)
                for connection, _, raw in reader.messages()
                if connection.topic == topic
            ]
        return [str(one.data) for one in messages]

    def texts_now(self, topic: str = "/topic") -> list[str]:
        """The same for a bag that is still open."""
        decode = codec_of(MessageSchema.of(String)).decode
        return [str(msgspec.msgpack.decode(decode(one))[0]) for one in self.messages_now(topic)]

    def messages_now(self, topic: str) -> list[bytes]:
        """The messages of a bag that is still open."""
        try:
            with open_bag(self.folder) as reader:
                return [bytes(message.data) for message in reader.messages(topics=[topic])]
        except BagError:  # it is still empty
            return []

    def messages(self, file: Path, topic: str = "/topic") -> list[Any]:
        """Schema, channel and message of one file, in order, by an MCAP reader that checks CRCs."""
        from mcap.reader import make_reader

        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            return list(reader.iter_messages(topics=[topic], log_time_order=False))

    def read_by_others(self) -> int:
        """Decode all messages by rosbags and mcap-ros2; returns how many."""
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
        from rosbags.highlevel import AnyReader

        count = 0
        for file in self.files:
            with file.open("rb") as stream:
                reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
                count += sum(1 for _ in reader.iter_decoded_messages())
        with AnyReader([self.folder]) as others:
            read = 0
            for connection, _, raw in others.messages():
                others.deserialize(raw, connection.msgtype)
                read += 1
            assert read == others.message_count == count
        return count

    def losses(self, file: Path | None = None) -> dict[str, TopicLosses]:
        """The last report of losses in the last file, or in this one."""
        from mcap.reader import make_reader

        with (file or self.files[-1]).open("rb") as stream:
            records = [one.metadata for one in make_reader(stream).iter_metadata() if one.name == RECORD]
        return from_record(records[-1])


@contextmanager
def speaking(name: str = "speaker", *, depth: int = 1000) -> Iterator[Speaker]:
    with script(SPEAKER, name, str(depth)) as running:
        yield Speaker(running)


@contextmanager
def recording(bag: Bag, *options: str) -> Iterator[Running]:
    """A started recorder, until the end of the block."""
    with start("bag", "record", "-o", str(bag.folder), *options) as running:
        running.error_line_with("Recording|Wait for recording")
        yield running


def end(running: Running) -> Result:
    """End it by Ctrl-C."""
    return running.end(signal.SIGINT)
