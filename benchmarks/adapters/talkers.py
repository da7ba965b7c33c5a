"""Programs that send one message to a running subscriber, each written like a user's program.

    python -m benchmarks.adapters.talkers <the system's adapter>

For startup.py. A talker imports only the packages that it needs, and not the harness: its imports take longer
than some libraries. Each waits until it reaches the subscriber of its adapter, sends, and ends.
"""

import os
import sys
from collections.abc import Callable
from time import monotonic_ns

TOPIC = "bench"
"""The same as `work.TOPIC`."""
SIZE = 64
"""Number of characters of the message, which begins with its stamps."""


def text() -> str:
    """The message, stamped now."""
    now_ns = monotonic_ns()
    return f"{now_ns} {now_ns} ".ljust(SIZE)


def bus_string() -> None:
    """busd, by either route."""
    import bus
    from bus.msg.std_msgs import String

    async def talk() -> None:
        async with bus.Node("bench_talker") as node:
            pub = await node.create_publisher(String, TOPIC)
            await pub.wait_for_subscriptions()
            pub.publish(String(data=text()))

    bus.run(talk())


def rclpy_string() -> None:
    """rclpy: busd's facade by `bus run`, or ROS 2's own."""
    import rclpy
    from std_msgs.msg import String

    rclpy.init()
    node = rclpy.create_node("bench_talker")
    publisher = node.create_publisher(String, TOPIC, 10)
    while not publisher.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.01)
    publisher.publish(String(data=text()))
    publisher.wait_for_all_acked()
    rclpy.shutdown()


def zeromq() -> None:
    """pyzmq without a proxy."""
    _talk_by_zmq(_subscriber_of_zmq())


def zeromq_asyncio() -> None:
    """pyzmq in a program of asyncio."""
    import asyncio

    import zmq
    import zmq.asyncio

    async def talk() -> None:
        with zmq.asyncio.Context() as context, context.socket(zmq.XPUB) as socket:
            socket.connect(_subscriber_of_zmq())
            await socket.recv()  # wait for a subscription
            await socket.send(text().encode())

    asyncio.run(talk())


def zeromq_proxy() -> None:
    """pyzmq, through the proxy."""
    _talk_by_zmq(f"ipc://{_path('proxy-in.sock')}")


def _subscriber_of_zmq() -> str:
    return f"ipc://{_path(_only('zmq-'))}"


def _talk_by_zmq(address: str) -> None:
    import zmq

    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.connect(address)
        socket.recv()  # wait for a subscription
        socket.send(text().encode())


def nats_core() -> None:
    """nats-py."""
    import asyncio

    import nats

    async def talk() -> None:
        client = await nats.connect(os.environ["BENCH_SERVER"])
        await client.publish(TOPIC, text().encode())
        await client.close()

    asyncio.run(talk())


def redis_pubsub() -> None:
    """redis-py with the blocking client."""
    import redis

    with redis.Redis.from_url(os.environ["BENCH_SERVER"]) as client:
        client.publish(TOPIC, text())


def zenoh_peer() -> None:
    """eclipse-zenoh, peer to peer."""
    import json
    import threading

    import zenoh

    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    address = f"unixsock-stream/{_path(_only('zenoh-', '.sock'))}"
    config.insert_json5("connect/endpoints", json.dumps([address]))
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(TOPIC)
        matched = threading.Event()
        publisher.declare_matching_listener(lambda status: matched.set())
        if not publisher.matching_status:
            matched.wait()
        publisher.put(text())


def ecal_shm() -> None:
    """eclipse-ecal, with the handshake of its shared memory and the settings of
    `benchmarks.adapters.ecal_shm`."""
    import threading

    import ecal.nanobind_core as ecal

    name = os.environ["BENCH_FOLDER"].rpartition("/")[2]
    config = ecal.get_configuration()
    registration = config.registration
    registration.local.transport_type = ecal.LocalTransportType.SHM
    registration.local.shm.domain = registration.shm_transport_domain = name
    if not os.environ.get("BENCH_ECAL_SHIPPED"):
        registration.registration_refresh = 100
    ecal.initialize(config, "talker", ecal.init.PUBLISHER)
    publishing = ecal.get_publisher_configuration()
    publishing.layer.shm.acknowledge_timeout_ms = 10_000
    matched = threading.Event()
    kind = ecal.DataTypeInformation("string", "utf-8")
    publisher = ecal.Publisher(name, kind, publishing, lambda *_: matched.set())
    matched.wait()
    publisher.send(text().encode())
    ecal.finalize()


def cyclone() -> None:
    """cyclonedds."""
    import threading
    from dataclasses import dataclass
    from zlib import crc32

    from cyclonedds.core import Listener, Policy, Qos
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.idl import IdlStruct
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    @dataclass
    class Text(IdlStruct, typename="bench.Text"):  # type: ignore[call-arg]
        data: str

    tag = os.environ["BENCH_FOLDER"].rpartition("/")[2]
    number = 1 + crc32(tag.encode()) % 100
    _domain = Domain(  # a domain without a reference is deleted with its configuration
        number,
        '<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>'
        "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
        f'<Peers><Peer Address="127.0.0.1"/></Peers><Tag>{tag}</Tag></Discovery></Domain></CycloneDDS>',
    )
    participant = DomainParticipant(number)
    matched = threading.Event()
    listener = Listener(on_publication_matched=lambda *_: matched.set())
    reliable = Qos(Policy.Reliability.Reliable(duration(seconds=10)))
    writer = DataWriter(participant, Topic(participant, TOPIC, Text), reliable, listener)
    matched.wait()
    writer.write(Text(data=text()))
    writer.wait_for_acks(duration(seconds=10))


def iceoryx() -> None:
    """iceoryx2. A publisher does not learn when its sample was taken, and its end deletes the sample; so it
    stays."""
    import ctypes

    import iceoryx2

    node = iceoryx2.NodeBuilder.new().create(iceoryx2.ServiceType.Ipc)
    name = iceoryx2.ServiceName.new(os.environ["BENCH_FOLDER"].rpartition("/")[2])
    service = node.service_builder(name).publish_subscribe(ctypes.c_uint8 * SIZE).open()
    notifier = node.service_builder(name).event().open().notifier_builder().create()
    publisher = service.publisher_builder().create()
    sample = publisher.loan_uninit()
    ctypes.memmove(sample.payload_ptr, text().encode(), SIZE)
    sample.assume_init().send()
    notifier.notify()
    sys.stdin.read()


def _path(name: str) -> str:
    return f"{os.environ['BENCH_FOLDER']}/{name}"


def _only(beginning: str, end: str = "") -> str:
    names = os.listdir(os.environ["BENCH_FOLDER"])  # noqa: PTH208 - pathlib takes time to import
    (name,) = (name for name in names if name.startswith(beginning) and name.endswith(end))
    return name


TALKERS: dict[str, Callable[[], None]] = {
    talk.__name__: talk
    for talk in (
        bus_string,
        rclpy_string,
        zeromq,
        zeromq_asyncio,
        zeromq_proxy,
        nats_core,
        redis_pubsub,
        zenoh_peer,
        ecal_shm,
        cyclone,
        iceoryx,
    )
}

if __name__ == "__main__":
    TALKERS[sys.argv[1]]()
