"""cyclonedds: DDS over UDP on loopback, reliable and keep all at both ends, so a flood loses nothing.

Datagrams and socket buffers have the largest possible size: with the defaults, 1 MiB is several times slower.
The subscriber waits in a WaitSet in a separate thread, because the library's documentation advises against
Python in listeners. It takes up to a hundred messages at once. There is no multicast: participants find each
other by their ports on loopback, and each run has another tag. The wheel has no shared memory.

If the environment has BENCH_ROS, the number of a domain, the participants use that domain, and ROS 2's names
for topic and type. Then they meet `bus bridge ros2`.
"""

import asyncio
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

from cyclonedds.core import (
    InstanceState,
    Listener,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from benchmarks.adapters import roles
from benchmarks.work import TOPIC, Work
from benchmarks.worker import Parent, options, run

_FOREVER = duration(weeks=1000)
_QOS = Qos(
    Policy.Reliability.Reliable(_FOREVER),
    Policy.History.KeepAll,
    Policy.DataRepresentation(use_cdrv0_representation=True),
)
_BATCH = 100
_DOMAINS = 100
"""Small enough for ports below the ports that the kernel assigns."""
_CONFIG = """<CycloneDDS><Domain><General>
    <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast>
    <MaxMessageSize>65500 B</MaxMessageSize><FragmentSize>65000 B</FragmentSize>
</General><Internal><SocketReceiveBufferSize min="4 MB"/></Internal><Discovery>
    <ParticipantIndex>auto</ParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers>{tag}
</Discovery></Domain></CycloneDDS>"""


_domains: list[Domain] = []
"""References to the domains. Without one, a domain is deleted, and a participant then makes one without this
configuration."""


@dataclass
class Text(IdlStruct, typename="bench.Text"):  # type: ignore[call-arg]
    """The message."""

    data: str


@dataclass
class RosText(IdlStruct, typename="std_msgs::msg::dds_::String_"):  # type: ignore[call-arg]
    """The message with the name that std_msgs/String has in DDS."""

    data: str


def _join() -> tuple[DomainParticipant, Topic[Any], Any]:
    """Make the participant and the topic; returns them and the class of the messages."""
    name = Path(os.environ["BENCH_FOLDER"]).name
    number, tag = 1 + crc32(name.encode()) % _DOMAINS, f"<Tag>{name}</Tag>"
    topic, kind = TOPIC, Text
    if of_ros := os.environ.get("BENCH_ROS"):
        number, tag, topic, kind = int(of_ros), "", f"rt/{TOPIC}", RosText
    _domains.append(Domain(number, _CONFIG.format(tag=tag)))
    participant = DomainParticipant(number)
    return participant, Topic(participant, topic, kind), kind


async def publisher(parent: Parent) -> None:
    work: Work = options(Work)
    loop, reached = asyncio.get_running_loop(), asyncio.Event()

    def count(_: object, status: Any) -> None:
        if status.current_count == work.subscribers:
            loop.call_soon_threadsafe(reached.set)

    participant, topic, kind = _join()
    listener = Listener(on_publication_matched=count)
    writer = DataWriter(participant, topic, _QOS, listener)
    await reached.wait()
    write = writer.write
    await roles.publish(parent, work, lambda text: write(kind(data=text)))


async def subscriber(parent: Parent) -> None:
    taker = roles.Taker(parent, options(Work))
    participant, topic, _ = _join()
    reader = DataReader(participant, topic, _QOS)
    roles.take_in_thread(taker, _texts(participant, reader).__next__)
    parent.tell("ready")
    await taker.finish()


def _texts(participant: DomainParticipant, reader: DataReader[Any]) -> Iterator[str]:
    # Also of a publisher that has ended before its message was taken. Then the end is a sample, too.
    condition = ReadCondition(reader, ViewState.Any | SampleState.NotRead | InstanceState.Any)
    waitset = WaitSet(participant)
    waitset.attach(condition)
    while True:
        for sample in reader.take(_BATCH, condition=condition):
            if sample.__class__ is not InvalidSample:
                yield sample.data
        waitset.wait(_FOREVER)


if __name__ == "__main__":
    run({"publisher": publisher, "subscriber": subscriber}[sys.argv[1]])
