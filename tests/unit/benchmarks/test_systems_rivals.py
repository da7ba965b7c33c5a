"""benchmarks/: each rival with a broker or pipes, measured once with few messages."""

import os
from pathlib import Path

import pytest

from benchmarks import machine, paced, servers, systems, throughput
from benchmarks.adapters import roles
from benchmarks.harness import START_S, Child, Failure, Group
from benchmarks.systems import NATS, PIPE, PYZMQ, PYZMQ_PROXY, QUEUE, REDIS, RIVALS, ROS, System
from benchmarks.work import AT_ONCE, Work

pytestmark = pytest.mark.landing

LARGEST = 4 << 20
ALL = [PIPE, QUEUE, PYZMQ, PYZMQ_PROXY, NATS, REDIS]
FANS = [system for system in ALL if system.fans_out]


def _name(value: object) -> str:
    return value.name if isinstance(value, System) else str(value)


def _or_skip(system: System) -> System:
    reason = system.missing()
    if reason:
        pytest.skip(reason)
    return system


def _received_by_two(system: System, work: Work) -> list[int]:
    """The number of messages that each of two subscribers takes from a flood."""
    with Group() as group:
        system.start_servers(group)
        publisher, subscribers = system.start_fan(group, work, 2)
        publisher.send("warm_up")
        for child in subscribers:
            group.expect(child, "warm", within_s=START_S)
        publisher.send("go")
        return [group.expect(child, "received", within_s=START_S)["count"] for child in subscribers]


@pytest.mark.parametrize("system", ALL, ids=_name)
def test_what_is_paced_arrives_with_its_stamps(system: System) -> None:
    work = Work(size=64, count=50, warm_up=10, rate=1000, take_by=system.takes_by)

    found = paced.measure(_or_skip(system), work)

    assert 0 < found["p50"] <= found["p99"] <= found["due_max"]


@pytest.mark.parametrize(
    ("system", "size", "count"),
    [(PIPE, 64, 6000), (QUEUE, 64, 6000), *((system, LARGEST, 8) for system in ALL)],
    ids=_name,
)
def test_a_flood_loses_nothing(system: System, size: int, count: int) -> None:
    work = Work(size=size, count=count, warm_up=2, take_by=system.takes_by)

    assert throughput.measure(_or_skip(system), work)["per_s"] > 0


@pytest.mark.parametrize("system", FANS, ids=_name)
def test_each_of_two_subscribers_gets_all(system: System) -> None:
    work = Work(size=1 << 10, count=6000, warm_up=10, take_by=system.takes_by, subscribers=2)

    assert _received_by_two(_or_skip(system), work) == [6010, 6010]


@pytest.mark.parametrize("system", FANS, ids=_name)
def test_a_message_is_sent_without_a_word(system: System) -> None:
    work = Work(size=64, count=1, warm_up=0, rate=1, publish_by=AT_ONCE, take_by=system.takes_by)

    with Group() as group:
        _or_skip(system).start_servers(group)
        publisher, subscriber = system.start_pair(group, work)
        group.expect(subscriber, "complete", within_s=START_S)
        subscriber.send("report")
        (age_ns,) = group.expect(subscriber, "received", within_s=START_S)["age_ns"]
        publisher.send("end")

    assert age_ns > 0


def test_a_flood_waits_for_its_slowest_subscriber() -> None:
    window = roles.Window(Work(size=64, count=1, warm_up=0, subscribers=2))

    def sent_until_full() -> int:
        count = 1
        while not window.sent():
            count += 1
        return count

    assert sent_until_full() == 4 * window.step
    # One subscriber has everything, the other nothing: half of the messages in flight may be for the other
    # one.
    assert all(window.taken() for _ in range(4))
    assert sent_until_full() == 2 * window.step
    assert roles.Window(Work(size=LARGEST, count=1, warm_up=0)).step == 1


def test_a_thread_that_takes_ends_the_process_when_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = """
from benchmarks.adapters import roles
from benchmarks.work import Work
from benchmarks.worker import run

async def main(parent):
    taker = roles.Taker(parent, Work(size=1, count=2, warm_up=0))
    roles.take_in_thread(taker, iter(["a"]).__next__)
    await taker.finish()

run(main)
"""
    (tmp_path / "taking.py").write_text(program)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")

    with pytest.raises(Failure, match="taking exited with 1: StopIteration"), Group() as group:
        group.expect(group.start_python("taking", "-m", "taking"), "received", within_s=START_S)


# --- servers


@pytest.mark.parametrize("system", [NATS, REDIS], ids=_name)
def test_a_server_that_is_nowhere_is_missing(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    _or_skip(system)
    monkeypatch.setattr(machine, "_PATH", os.devnull)

    assert system.missing().endswith("-server is not on PATH")


@pytest.mark.parametrize("serve", [servers.serve_nats, servers.serve_redis], ids=lambda serve: serve.__name__)
@pytest.mark.parametrize(
    ("program", "complaint"), [("exit 3", "exited with 3"), ("sleep 60", "is not ready after 0.3 s")]
)
def test_a_server_that_does_not_come_up_is_a_failure(
    serve: object, program: str, complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("nats-server", "redis-server"):
        path = tmp_path / name
        path.write_text(f"#!/bin/sh\nexec sh -c '{program}'\n")
        path.chmod(0o755)
    monkeypatch.setattr(machine, "_PATH", str(tmp_path))
    if "ready" in complaint:
        monkeypatch.setattr(servers, "START_S", 0.3)

    assert callable(serve)
    with pytest.raises(Failure, match=complaint), Group() as group:
        serve(group, "")


def test_servers_leave_nothing_behind() -> None:
    for system in (NATS, REDIS):
        with Group() as group:
            started: list[Child] = _or_skip(system).start_servers(group)
        assert not any(Path(f"/proc/{child.pid}").exists() for child in started)
        assert not group.folder.exists()


@pytest.mark.parametrize("system", [one for one in RIVALS if one not in (PIPE, QUEUE, ROS)], ids=_name)
def test_a_rival_whose_package_is_not_there_is_missing(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(systems, "find_spec", lambda name: None)

    assert system.missing().endswith(" is not installed")
