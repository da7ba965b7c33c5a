"""Recordings in tests: `bus bag record` as a process, and what is in its bag."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bus_bag.losses import RECORD, TopicLosses, from_record
from bus_bag.metadata import BagMetadata, from_yaml
from cli import Result, Running, start

__all__ = ["Bag", "recording"]


class Bag:
    """A bag that was recorded, as the readers of others see it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @property
    def metadata(self) -> BagMetadata:
        return from_yaml((self.folder / "metadata.yaml").read_text())

    @property
    def files(self) -> list[Path]:
        """In their order."""
        return sorted(self.folder.glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2]))

    def texts(self, topic: str = "/topic") -> list[str]:
        """The field `data` of each message, as rosbags reads the whole bag."""
        from rosbags.highlevel import AnyReader

        with AnyReader([self.folder]) as reader:
            messages: list[Any] = [
                reader.deserialize(raw, connection.msgtype)
                for connection, _, raw in reader.messages()
                if connection.topic == topic
            ]
        return [str(one.data) for one in messages]

    def messages(self, file: Path) -> list[Any]:
        """Of one file, in its order, by the reader of MCAP that looks at CRCs: schema, channel, message."""
        from mcap.reader import make_reader

        with file.open("rb") as stream:
            return list(make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False))

    def losses(self, file: Path | None = None) -> dict[str, TopicLosses]:
        """The last account in the last file, or in this one."""
        from mcap.reader import make_reader

        with (file or self.files[-1]).open("rb") as stream:
            records = [one.metadata for one in make_reader(stream).iter_metadata() if one.name == RECORD]
        return from_record(records[-1])


@contextmanager
def recording(folder: Path, *options: str) -> Iterator[Running]:
    """A recorder that has begun, until the end of the block."""
    with start("bag", "record", "-o", str(folder), *options) as running:
        running.error_line_with("Recording|Wait for recording")
        yield running


def end(running: Running) -> Result:
    """Ctrl-C."""
    return running.end(signal.SIGINT)
