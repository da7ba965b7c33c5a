"""benchmarks/fanout: counting, refusals, comparisons, and each kind of fan-out measured with few messages."""

import json
import os
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from benchmarks import fanout
from benchmarks.adapters.bus_fanout import Fan
from benchmarks.cases import Figures, Outcome
from benchmarks.harness import Failure
from benchmarks.systems import (
    BUS,
    BUS_FAN_OUT,
    BUS_SOCKET,
    BUS_SOCKET_FAN_OUT,
    NATS,
    PYZMQ,
    System,
)
from benchmarks.work import Work

pytestmark = pytest.mark.landing

# --- accounting, with a system that says what the test wants

PUPPET = """
import json, os, sys
def tell(event): print(json.dumps(event), flush=True)
for number, says in enumerate(json.loads(os.environ["SAYS"])[sys.argv[1]]):
    try:
        os.close(os.open(f"{os.environ['BENCH_FOLDER']}/{sys.argv[1]}-{number}", os.O_CREAT | os.O_EXCL))
        break
    except FileExistsError:
        pass
tell({"event": "ready"})
for event in says.get("at once", ()):
    tell(event)
for word in sys.stdin:
    events = says.get(word.strip())
    if events:
        tell(events.pop(0) if len(events) > 1 else events[0])
"""
FLOOD = Work(size=64, count=1000, warm_up=10, subscribers=2)
PACED = Work(size=64, count=3, warm_up=0, rate=1000.0, subscribers=2)
LOSSY = Fan(size=64, count=99, subscribers=2)
SENT = {"event": "sent", "begin_ns": 1_000_000_000, "cpu_ns": 50_000}


@pytest.fixture
def puppet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    (tmp_path / "puppet_system.py").write_text(PUPPET)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    return System("puppet", "puppet_system")


def _say(monkeypatch: pytest.MonkeyPatch, *subscribers: dict[str, Any], sent: bool = True) -> None:
    """Make the publisher report that it has sent, and each subscriber answer each word as given."""
    publisher = {"go": [SENT]} if sent else {}
    monkeypatch.setenv("SAYS", json.dumps({"publisher": [publisher], "subscriber": subscribers}))


def _received(count: int, end_s: float = 1.5, **dropped: int) -> dict[str, Any]:
    return {"event": "received", "end_ns": int(end_s * 1e9), "count": count, "dropped": dropped}


def _took_all(end_s: float) -> dict[str, Any]:
    return {"at once": [{"event": "warm"}, _received(1010, end_s)]}


def test_deliveries_are_those_of_all_until_the_slowest_is_done(
    puppet: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    _say(monkeypatch, _took_all(1.1), _took_all(1.5))

    found = fanout.measure_flood(puppet, FLOOD)

    assert found["deliveries_per_s"] == pytest.approx(4000)
    assert found["lost"] == 0
    assert found["cpu"] >= 0


@pytest.mark.parametrize("received", [_received(1009), _received(1010, replaced=1), _received(1011)])
def test_a_flood_that_lost_something_is_a_failure(
    puppet: System, monkeypatch: pytest.MonkeyPatch, received: dict[str, Any]
) -> None:
    _say(monkeypatch, _took_all(1.1), {"at once": [{"event": "warm"}, received]})

    with pytest.raises(Failure, match=rf"{received['count']} of 1010 arrived"):
        fanout.measure_flood(puppet, FLOOD)


def test_what_may_lose_is_asked_until_nothing_comes_any_more(
    puppet: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fanout, "_LOOK_S", 0.0)
    seen = [{"event": "seen", "end_ns": 1_500_000_000, "count": count} for count in (200, 500)]
    _say(monkeypatch, {"look": seen}, {"look": [seen[1] | {"count": 1000}]})
    work = msgspec.structs.replace(FLOOD, warm_up=0)

    found = fanout.measure_flood(puppet._replace(may_lose=True), work)

    assert found["deliveries_per_s"] == pytest.approx(3000)
    assert found["lost"] == pytest.approx(25)


def test_more_than_was_sent_and_nothing_at_all_are_failures(
    puppet: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fanout, "_LOOK_S", 0.0)
    system, work = puppet._replace(may_lose=True), msgspec.structs.replace(FLOOD, warm_up=0)

    for count, text in ((1001, "1001 of 1000 arrived"), (0, "nothing arrived")):
        seen = {"look": [{"event": "seen", "end_ns": 1_500_000_000, "count": count}]}
        _say(monkeypatch, seen, seen)
        with pytest.raises(Failure, match=text):
            fanout.measure_flood(system, work)


def test_a_subscriber_that_hangs_is_a_failure(puppet: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fanout, "_LIMIT_S", 0.2)
    _say(monkeypatch, _took_all(1.1), {"at once": [{"event": "warm"}]})

    # On a busy machine, an earlier step may be the late one.
    with pytest.raises(Failure, match=r"did not say '(warm|sent|received)'"):
        fanout.measure_flood(puppet, FLOOD)


def test_an_event_without_its_values_is_a_failure(puppet: System, monkeypatch: pytest.MonkeyPatch) -> None:
    _say(monkeypatch, _took_all(1.1), {"at once": [{"event": "warm"}, {"event": "received"}]})

    with pytest.raises(Failure, match="the event 'received' came without 'count'"):
        fanout.measure_flood(puppet, FLOOD)


def test_the_last_is_found_for_each_message(puppet: System, monkeypatch: pytest.MonkeyPatch) -> None:
    ages = ([1000, 9000, 2000], [5000, 3000, 4000])
    _say(
        monkeypatch,
        *(
            {"at once": [{"event": "complete"}], "report": [{"event": "received", "age_ns": one}]}
            for one in ages
        ),
    )

    found = fanout.measure_last(puppet, PACED)

    assert (found["last_p50"], found["last_max"]) == pytest.approx((5, 9))


def test_what_a_lossy_publisher_lost_is_told_by_reason(
    puppet: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    _say(monkeypatch, *[{"at once": [_received(75, replaced=20, overrun=5)]}] * 2)

    found = fanout.measure_lossy(puppet, LOSSY)

    assert found["deliveries_per_s"] == pytest.approx(300)
    assert found["cpu_publish_ns"] == pytest.approx(500)
    assert (found["lost"], found["replaced"], found["overrun"]) == pytest.approx((25, 20, 5))


def test_a_message_of_which_nobody_knows_what_became_is_a_failure(
    puppet: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    _say(monkeypatch, *[{"at once": [_received(75, replaced=24)]}] * 2)

    with pytest.raises(Failure, match="75 of 100 arrived"):
        fanout.measure_lossy(puppet, LOSSY)


# --- comparisons


def _outcome(name: str, *repetitions: Figures) -> tuple[str, Outcome]:
    return name, Outcome(name, list(repetitions))


def test_the_goals_are_against_the_best_that_loses_nothing() -> None:
    def figures(rate: float, last: float, lost: float = 0.0) -> Figures:
        return {"deliveries_per_s": rate, "last_p50": last, "last_p99": 2 * last, "lost": lost}

    outcomes = dict(
        [
            _outcome(fanout.name_of(BUS, 8), figures(5e6, 100)),
            _outcome(fanout.name_of(BUS_SOCKET, 8), figures(5e5, 300)),
            _outcome(fanout.name_of(PYZMQ, 8), figures(9e6, 90, lost=10)),
            _outcome(fanout.name_of(NATS, 8), figures(1e6, 200)),
        ]
    )

    found = {one.name: one for one in fanout.comparisons(outcomes, [BUS, BUS_SOCKET, PYZMQ, NATS])}

    ours, socket = (fanout.name_of(one, 8) for one in (BUS, BUS_SOCKET))
    rate = found[f"{ours} / best rival ({fanout.name_of(NATS, 8)}), deliveries/s"]
    last = found[f"{ours} / best rival ({fanout.name_of(PYZMQ, 8)}), time to the last, p50"]
    broker = found[f"{socket} / best rival ({fanout.name_of(NATS, 8)}), deliveries/s with a broker"]
    assert (rate.value.median, rate.is_met) == (5, True)
    assert last.value.median == pytest.approx(100 / 90)
    assert not last.is_met
    assert (broker.value.median, broker.is_met) == (0.5, False)
    assert found[f"{ours}, deliveries/s"].is_met


# --- real systems, few messages


@pytest.mark.parametrize("system", [BUS, BUS_SOCKET, PYZMQ], ids=lambda system: system.name)
def test_fan_out_of_systems(system: System) -> None:
    if reason := system.missing():
        pytest.skip(reason)
    flood = Work(size=64, count=3000, warm_up=100, take_by=system.takes_by, subscribers=3)
    paced = msgspec.structs.replace(flood, count=50, warm_up=5, rate=500.0)

    found = fanout.measure(system, partial(fanout.measure_flood, system, flood), paced)

    assert found["deliveries_per_s"] > 0
    assert found["lost"] == 0
    assert 0 < found["last_p50"] <= found["last_p99"]


@pytest.mark.parametrize("system", [BUS_FAN_OUT, BUS_SOCKET_FAN_OUT], ids=lambda system: system.route)
def test_lossy_fan_out_of_busd(system: System) -> None:
    if reason := system.missing():
        pytest.skip(reason)

    found = fanout.measure_lossy(system, msgspec.structs.replace(LOSSY, count=3000))

    assert found["deliveries_per_s"] > 0
    assert 0 <= found["lost"] < 100
