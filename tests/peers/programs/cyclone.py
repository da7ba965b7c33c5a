"""A participant of cyclonedds alone: `python cyclone.py DOMAIN`.

Topics and types are named as ROS 2 names them; there is std_msgs/msg/String only. CYCLONEDDS_URI is heeded.
"""

import sys
import threading
from dataclasses import dataclass
from typing import Any

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
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from orders import serve, tell


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):  # type: ignore[call-arg,misc]
    data: str


def qos_of(depth: int = 10, reliability: str = "reliable", durability: str = "volatile") -> Qos:
    """`depth` 0 is keep all."""
    is_reliable = reliability == "reliable"
    return Qos(
        Policy.History.KeepLast(depth) if depth else Policy.History.KeepAll,
        Policy.Reliability.Reliable(duration(seconds=30)) if is_reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if durability == "transient_local" else Policy.Durability.Volatile,
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


class Peer:
    def __init__(self, domain: int) -> None:
        self._participant = DomainParticipant(domain)
        self._topics: dict[str, Any] = {}
        self._writers: dict[str, Any] = {}
        self._readers: dict[str, Any] = {}

    def _topic(self, name: str) -> Any:
        if name not in self._topics:
            self._topics[name] = Topic(self._participant, f"rt{name}", String)
        return self._topics[name]

    def publish(self, topic: str, type_name: str, **qos: Any) -> None:
        self._writers[topic] = DataWriter(self._participant, self._topic(topic), qos_of(**qos))

    def send(self, topic: str, data: str) -> None:
        self._writers[topic].write(String(data))

    def burst(self, topic: str, count: int) -> None:
        """So many messages, numbered, of a new writer that keeps all, as soon as a reader is matched."""
        matched = threading.Event()
        listener = Listener(on_publication_matched=lambda writer, status: matched.set())
        self._writers[topic] = writer = DataWriter(
            self._participant, self._topic(topic), qos_of(depth=0), listener
        )
        matched.wait()
        for number in range(count):
            writer.write(String(str(number)))

    def listen(self, topic: str, type_name: str, **qos: Any) -> None:
        self._readers[topic] = reader = DataReader(self._participant, self._topic(topic), qos_of(**qos))
        threading.Thread(target=self._take, args=(topic, reader), daemon=True).start()

    def _take(self, topic: str, reader: Any) -> None:
        # Also of a publisher that has ended before its message was taken. Then the end is a sample, too.
        condition = ReadCondition(reader, ViewState.Any | SampleState.NotRead | InstanceState.Any)
        waitset = WaitSet(self._participant)
        waitset.attach(condition)
        while True:
            for sample in reader.take(100, condition=condition):
                if isinstance(sample, InvalidSample):
                    continue
                time_ns = sample.sample_info.source_timestamp
                tell(heard=topic, message={"data": sample.data}, source_time_ns=time_ns)
            waitset.wait(duration(seconds=1))

    def matched(self, topic: str) -> list[int]:
        """Readers that are matched with its writer, and writers with its reader."""
        writer, reader = self._writers.get(topic), self._readers.get(topic)
        return [
            len(writer.get_matched_subscriptions()) if writer else 0,
            len(reader.get_matched_publications()) if reader else 0,
        ]


if __name__ == "__main__":
    peer = Peer(int(sys.argv[1]))
    serve({order: getattr(peer, order) for order in ("publish", "send", "burst", "listen", "matched")})
