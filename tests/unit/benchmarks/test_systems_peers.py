"""benchmarks/adapters: each rival without a server, measured with few messages. Missing ones are skipped."""

import msgspec
import pytest

from benchmarks import startup, throughput
from benchmarks.harness import START_S, Group
from benchmarks.systems import CYCLONE, ECAL, ICEORYX, ZENOH, System
from benchmarks.work import AT_ONCE, HEAD, Work

pytestmark = pytest.mark.landing

LIMIT_S = 30.0
PEERS = pytest.mark.parametrize("system", [ZENOH, ECAL, CYCLONE, ICEORYX], ids=lambda system: system.name)


def _installed(system: System) -> System:
    reason = system.missing()
    if reason:
        pytest.skip(reason)
    return system


def _for(system: System, work: Work) -> Work:
    return msgspec.structs.replace(work, take_by=system.takes_by)


@PEERS
@pytest.mark.parametrize("size", [HEAD, 1 << 20])
def test_a_paced_stream_reaches_two_subscribers(system: System, size: int) -> None:
    work = _for(_installed(system), Work(size=size, count=20, warm_up=2, rate=200, subscribers=2))

    with Group() as group:
        system.start_servers(group)
        publisher, subscribers = system.start_fan(group, work, work.subscribers)
        publisher.send("go")
        for child in subscribers:
            group.expect(child, "complete", within_s=LIMIT_S)
            child.send("report")
            received = group.expect(child, "received", within_s=START_S)

            assert len(received["age_ns"]) == work.count
            assert min(received["age_ns"]) > 0


@PEERS
def test_a_flood_loses_nothing(system: System) -> None:
    work = _for(_installed(system), Work(size=1 << 16, count=300, warm_up=30))

    found = throughput.measure(system, work)

    assert found["lost"] == 0
    assert found["cpu_publisher"] > 0


@PEERS
def test_one_message_is_sent_as_soon_as_somebody_is_there(system: System) -> None:
    work = _for(_installed(system), Work(size=HEAD, count=1, warm_up=0, rate=1, publish_by=AT_ONCE))

    with Group() as group:
        system.start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        group.expect(subscriber, "complete", within_s=LIMIT_S)
        publisher.send("end")
        subscriber.send("report")

        assert group.expect(subscriber, "received", within_s=START_S)["at_ns"] > 0


@PEERS
def test_a_talker_reaches_the_subscriber(system: System) -> None:
    assert startup.measure_first_message(_installed(system))["ms"] > 0


def test_iceoryx_is_read_in_place() -> None:
    work = Work(size=1 << 20, count=40, warm_up=4, publish_by="loan", take_by="polling")

    assert throughput.measure(_installed(ICEORYX), work)["lost"] == 0
