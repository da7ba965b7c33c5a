"""The way in, with a publisher and a reader that the test controls."""

import asyncio
import time
from typing import Any

import pytest

from bus.endpoint.matches import Match
from bus.errors import ConnectionClosed, PayloadTooLarge
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bridge.batch import Loose, Sample
from bus_bridge.core import far_reading, imports, publishing
from bus_bridge.core.accounts import Account
from bus_bridge.core.imports import Import
from bus_bridge.core.lateness import Lateness
from bus_bridge.core.pasts import Past
from bus_bridge.engine import FarEndpoint
from bus_bridge.errors import BridgeError, in_words
from semantics import until

LOSSLESS = QoSProfile(history="keep_all")
LISTENER, OTHER = b"listener" * 2, b"another." * 2


def matched(*gids: bytes) -> tuple[Match, ...]:
    return tuple(Match("/listener", gid, QoSProfile(10), "shm") for gid in gids)


class Publisher:
    """Takes as many messages as it has room for."""

    def __init__(self) -> None:
        self.matches = matched(LISTENER)
        self.room = 1 << 30
        self.published: list[tuple[bytes, int | None]] = []
        self.error: Exception | None = None
        self._has_room = asyncio.Event()

    def publish_encoded(self, payload: bytes, *, source_time_ns: int | None = None) -> bool:
        if self.error is not None:
            raise self.error
        if not self.room:
            return False
        self.room -= 1
        self.published.append((payload, source_time_ns))
        return True

    def give_room(self, number: int) -> None:
        self.room += number
        self._has_room.set()

    async def wait_for_room(self) -> None:
        self._has_room.clear()
        await self._has_room.wait()


class Engine:
    """Also stands for its reader."""

    def __init__(self) -> None:
        self.error: Exception | None = None
        self.lost: dict[str, int] = {}
        self.credit = 0
        self.reads = 0
        self.closes = 0

    def read(self, *_: object, restores: bool) -> "Engine":
        if self.error is not None:
            raise self.error
        self.reads += 1
        return self

    def taken(self, size: int) -> None:
        self.credit += size

    def close(self) -> None:
        self.closes += 1


class Way:
    def __init__(
        self,
        qos: QoSProfile | int = 10,
        past: Past | None = None,
        max_rate_hz: float | None = None,
        numbering: str = "",
    ) -> None:
        self.publisher = Publisher()
        self.engine = Engine()
        self.troubles: list[str] = []
        profile = QoSProfile(qos) if isinstance(qos, int) else qos
        schema = MessageSchema.of(String)
        endpoint = FarEndpoint(
            "publisher", bytes(16), "far/1", "/t", schema.type_name, schema.type_hash, profile
        )
        mirror: Any = self.publisher
        engine: Any = self.engine
        self.way = Import(
            engine,
            endpoint,
            schema,
            mirror,
            Lateness(),
            self.troubles.append,
            numbering=numbering,
            max_rate_hz=max_rate_hz,
        )
        if past is not None:
            self.way.resume(past)
        self.endpoint = endpoint
        self.way.on_matched()

    def match(self, *gids: bytes) -> None:
        self.publisher.matches = matched(*gids)
        self.way.on_matched()

    def receive(self, *numbers: int, at_ns: int = 1_000) -> None:
        self.way.receive(Loose([Sample(b"12", number, at_ns) for number in numbers]))

    @property
    def closes(self) -> bool:
        account = self.way.account
        return account.waiting == self.way.waiting and account.sent == len(self.publisher.published)


async def test_it_reads_while_there_is_a_subscription() -> None:
    way = Way()
    assert (way.engine.reads, way.way.is_flowing) == (1, True)
    way.way.on_matched()
    assert way.engine.reads == 1
    way.receive(1, 2, 3)
    assert way.publisher.published == [(b"12", 1_000)] * 3
    assert way.closes
    await way.way.finish()
    assert way.engine.closes == 1
    way.receive(4)
    assert len(way.publisher.published) == 3


async def test_numbers_tell_what_comes_twice_and_what_is_lost() -> None:
    way = Way()
    way.receive(5, 6)  # the first number may be any
    way.receive(6, 8, 7)
    way.receive(0, 0)  # from an engine without numbers
    way.receive(9)
    assert way.way.losses == {"repeated": 2, "lost_on_the_way": 1}
    assert len(way.publisher.published) == 6
    assert way.closes


@pytest.mark.parametrize("qos", [QoSProfile(10), LOSSLESS], ids=["reliable", "lossless"])
async def test_a_rule_bounds_the_rate_of_what_comes_in(qos: QoSProfile) -> None:
    way = Way(qos, max_rate_hz=10.0)
    for number in range(1, 41):  # at 40 Hz
        way.receive(number, at_ns=number * 25_000_000)
    assert [time_ns for _, time_ns in way.publisher.published] == [
        number * 25_000_000 for number in range(1, 41, 4)
    ]
    assert way.way.losses == {"rate_limit": 30} and way.closes
    assert way.engine.credit == (80 if qos is LOSSLESS else 0)  # dropped messages give credit, too


async def test_what_the_engine_had_and_lost_was_taken_and_dropped() -> None:
    way = Way()
    way.receive(1, 2, 2)
    way.engine.lost = {"undecodable": 4}
    assert way.way.losses == {"repeated": 1, "undecodable": 4}
    way.way.begin_again(way.endpoint)  # another reader, which counts from 0
    way.engine.lost = {"undecodable": 1}
    assert way.way.losses == {"repeated": 1, "undecodable": 5}
    assert way.way.taken == way.way.account.sent + sum(way.way.losses.values())


async def test_numbers_of_messages_lost_in_the_engine_are_not_lost_on_the_way_too() -> None:
    way = Way()
    way.receive(1)
    way.engine.lost = {"undecodable": 1, "memory_limit": 1}
    way.receive(4)
    assert way.way.losses == {"undecodable": 1, "memory_limit": 1}
    way.receive(6)
    assert way.way.losses == {"undecodable": 1, "memory_limit": 1, "lost_on_the_way": 1}
    way.engine.lost = {"undecodable": 1, "memory_limit": 1, "repeated": 3}  # these leave no gap
    way.receive(8)
    assert way.way.losses["lost_on_the_way"] == 2
    assert way.closes


async def test_what_the_engine_had_lost_stays_counted_when_the_publisher_returns() -> None:
    before = Way()
    before.receive(1, 2)
    before.engine.lost = {"undecodable": 3}
    past = before.way.past()
    before.way.end()
    assert past.lost_before == {"undecodable": 3}
    way = Way(past=past)
    assert (way.way.taken, way.way.losses) == (5, {"undecodable": 3})
    way.engine.lost = {"undecodable": 1}
    way.receive(3)
    assert (way.way.taken, way.way.losses) == (7, {"undecodable": 4})
    assert way.way.past().lost_before == {"undecodable": 4}


async def test_what_came_before_the_far_side_was_away_does_not_come_again() -> None:
    way = Way()
    way.receive(1, 2, 3)
    way.way.begin_again(way.endpoint)
    assert way.engine.reads == 2
    way.receive(2, 3, 7)  # 2 and 3 are history; the subscription was there for the rest
    assert len(way.publisher.published) == 4
    assert way.way.losses == {"repeated": 2, "lost_on_the_way": 3}


async def test_what_nobody_listened_to_is_not_lost() -> None:
    way = Way()
    way.receive(1, 2, 3)
    way.match()
    way.way.begin_again(way.endpoint)
    way.match(OTHER)
    way.receive(3, 7)
    assert way.way.losses == {"repeated": 1}


async def test_what_is_missed_while_busd_is_away_for_long_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(far_reading, "_LINGER_S", 0.0)
    way = Way()
    way.match(LISTENER, OTHER)
    way.receive(1, 2, 3)
    way.match(OTHER)
    way.match()
    way.receive(4)  # no subscription gets this
    await until(lambda: way.engine.closes)
    way.match(LISTENER)
    way.receive(7)
    assert way.way.losses == {"lost_on_the_way": 2}


async def test_in_transit_another_bridge_counts_from_one_again() -> None:
    way = Way()
    way.receive(1, 2, 3)
    way.way.begin_again(way.endpoint, numbering="mid/2")
    way.receive(1, 2, at_ns=2_000)
    assert len(way.publisher.published) == 5
    assert way.way.losses == {}


@pytest.mark.parametrize("qos", [QoSProfile(2), LOSSLESS], ids=["reliable", "lossless"])
async def test_what_came_by_one_way_does_not_come_again_by_another(qos: QoSProfile) -> None:
    before = Way(qos)
    for number in (11, 12, 13):
        before.receive(number, at_ns=number * 1_000)
    there = Way(qos, past=before.way.past(), numbering="mid/1")
    for number in (1, 2, 3):  # as many as its depth waited for the second way
        there.receive(number, at_ns=(number + 11) * 1_000)
    assert there.publisher.published == [(b"12", 14_000)]
    assert there.way.losses == {"repeated": 2}
    back = Way(qos, past=there.way.past())  # by the first way again, which is far ahead of the second
    for number in (14, 20):
        back.receive(number, at_ns=number * 1_000)
    assert back.publisher.published == [(b"12", 20_000)]
    assert back.way.account.dropped == {"repeated": 3}
    assert back.way.account.lost == 5
    assert (back.way.account.taken, back.way.account.sent) == (8, 5)
    if qos is LOSSLESS:
        assert there.engine.credit == 6 and back.engine.credit == 4  # dropped messages give credit, too


async def test_by_another_way_a_clock_that_was_set_back_repeats_nothing_beyond_the_depth() -> None:
    before = Way(2)
    before.receive(1, 2, 3, at_ns=5_000)
    way = Way(2, past=before.way.past(), numbering="mid/1")
    way.receive(1, 2, 3, 4, at_ns=1_000)
    assert way.way.losses == {"repeated": 2}
    assert len(way.publisher.published) == 2


async def test_in_transit_what_is_kept_for_late_joiners_does_not_come_again() -> None:
    way = Way(QoSProfile(2, durability="transient_local"))
    for number in (1, 2, 3):
        way.receive(number, at_ns=number * 1_000)
    way.way.begin_again(way.endpoint, numbering="mid/2")
    way.receive(1, at_ns=2_000)
    way.way.receive(Loose([Sample(b"12", 2, 3_000), Sample(b"12", 3, 4_000), Sample(b"12", 5, 5_000)]))
    assert [source_ns for _, source_ns in way.publisher.published] == [1_000, 2_000, 3_000, 4_000, 5_000]
    assert way.way.losses == {"repeated": 2, "lost_on_the_way": 1}
    way.way.begin_again(way.endpoint, numbering="mid/3")
    for number in (1, 2, 3):  # the clock was set back; the past has 2 of an earlier time at most
        way.receive(number, at_ns=number)
    assert way.publisher.published[5:] == [(b"12", 3)]


async def test_a_new_mirror_goes_on_where_the_one_before_ended() -> None:
    before = Way()
    before.receive(1, 2, 3, 5)
    way = Way(past=before.way.past())
    way.receive(4, 5, 9)
    assert [len(one.publisher.published) for one in (before, way)] == [4, 1]
    assert way.way.losses == {"repeated": 2, "lost_on_the_way": 4}
    assert (way.way.account.taken, way.way.account.sent) == (7, 5)


@pytest.mark.parametrize(
    ("before", "now", "lost"),
    [
        ([LISTENER], [LISTENER], 5),
        ([LISTENER, OTHER], [OTHER], 5),
        ([OTHER], [LISTENER], 0),  # a new listener after the return has missed nothing
        ([], [LISTENER], 0),
    ],
)
async def test_what_was_missed_is_lost_for_those_that_listened_before(
    before: list[bytes], now: list[bytes], lost: int
) -> None:
    way = Way(past=Past(3, frozenset(before), Account(), {}))
    way.match(*now)  # at any time after the return
    way.receive(3, 9, 10)
    assert way.way.account.dropped == {"repeated": 1} and way.way.account.lost == lost
    way.receive(12)
    assert way.way.account.lost == lost + 1


@pytest.mark.parametrize("error", [BridgeError("a reason"), RuntimeError("a fault of the engine")])
async def test_what_can_not_be_read_is_tried_again(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(far_reading, "_RETRY_S", 0.01)
    way = Way()
    way.engine.error = error
    way.way.begin_again(way.endpoint)
    assert way.troubles == [in_words(error)] and not way.way.is_flowing
    way.engine.error = None
    await until(lambda: way.way.is_flowing)
    assert way.engine.reads == 2


async def test_what_is_missed_until_the_far_side_can_be_read_again_is_lost() -> None:
    way = Way()
    way.receive(1, 2, 3)
    way.engine.error = BridgeError("the publisher is not known yet")
    way.way.begin_again(way.endpoint)
    assert way.troubles == ["the publisher is not known yet"]
    assert way.way.past().listeners == {LISTENER}
    way.engine.error = None
    way.way.begin_again(way.endpoint)
    way.receive(7)
    assert way.way.losses == {"lost_on_the_way": 3}


async def test_a_new_latched_mirror_has_for_late_joiners_what_the_one_before_had() -> None:
    way = Way(
        QoSProfile(5, durability="transient_local"), past=Past(5, frozenset((LISTENER,)), Account(), {})
    )
    way.receive(4, 5, 6, 6)
    assert len(way.publisher.published) == 3
    assert way.way.losses == {"repeated": 1}


async def test_a_lossless_way_waits_for_room_and_gives_credit_for_what_has_gone() -> None:
    way = Way(LOSSLESS)
    way.publisher.room = 2
    way.receive(1, 2, 3, 4)
    assert (way.engine.credit, way.way.waiting) == (4, 2)
    await asyncio.sleep(0)
    finishing = asyncio.create_task(way.way.finish())  # the publisher has gone; queued messages still leave
    await asyncio.sleep(0)
    way.publisher.give_room(10)
    await finishing
    assert len(way.publisher.published) == 4
    assert way.way.account.dropped == {}
    assert way.closes


async def test_what_is_dropped_gives_credit_too() -> None:
    way = Way(LOSSLESS)
    way.receive(1, 2)
    way.receive(1, 2)
    assert way.engine.credit == 8
    assert way.way.losses == {"repeated": 2}


async def test_what_has_no_room_is_held_up_to_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publishing, "_MOST_BYTES", 4)
    monkeypatch.setattr(publishing, "_STUCK_S", 0.0)
    way = Way(LOSSLESS)
    way.publisher.room = 0
    way.receive(1, 2, 3)
    way.receive(4)
    assert (way.way.waiting, way.engine.credit) == (2, 4)
    assert way.way.losses == {"memory_limit": 2} and way.closes
    await way.way.finish()
    assert way.way.losses == {"memory_limit": 2, "disconnected": 2} and way.closes
    assert way.troubles == ["their publisher has gone, and there was no room for all (messages lost: 2)"]


async def test_what_this_bus_does_not_take_is_counted_and_said() -> None:
    way = Way()
    way.publisher.error = PayloadTooLarge("/t", size_bytes=2, limit_bytes=1)
    way.receive(1)
    assert way.way.losses == {"too_large": 1}
    assert not way.way.is_broken
    way.publisher.error = ConnectionClosed("this publisher is closed")
    way.receive(2)
    assert way.way.losses == {"too_large": 1, "refused": 1}
    assert way.way.is_broken
    way.publisher.error = PayloadTooLarge("/t", size_bytes=2, limit_bytes=1)
    way.receive(3)
    assert way.way.is_broken  # until there is another publisher
    way.publisher.error = RuntimeError("a fault")
    way.receive(4)
    assert way.troubles[-1] == "RuntimeError: a fault"


async def test_a_time_that_can_be_none_is_left_out() -> None:
    way = Way()
    for at_ns in (0, -5, 1 << 63):
        way.receive(0, at_ns=at_ns)
    assert [time for _, time in way.publisher.published] == [None] * 3


async def test_a_far_clock_that_is_set_back_makes_nothing_old() -> None:
    way = Way(QoSProfile(10, lifespan=0.5))
    # Not monotonic_ns(): just after a boot, that time minus an hour is negative.
    hour_ns, now_ns = 3600 * 10**9, time.time_ns()
    way.receive(1, at_ns=now_ns)
    way.receive(2, 3, at_ns=now_ns - hour_ns)
    way.receive(4, at_ns=now_ns)  # and forward again
    way.receive(5, at_ns=now_ns - hour_ns)
    assert [source_ns for _, source_ns in way.publisher.published][0::4] == [now_ns, now_ns - hour_ns]
    assert way.way.losses == {}


async def test_a_clock_of_ours_that_is_set_makes_nothing_old(monkeypatch: pytest.MonkeyPatch) -> None:
    way = Way(QoSProfile(10, lifespan=0.5))
    way.receive(1, at_ns=time.time_ns())
    real = time.time_ns
    # If the code asked for that time at all, it would get this one:
    monkeypatch.setattr(time, "time_ns", lambda: real() + 10 * 10**9)
    monkeypatch.setattr(imports, "time_ns", time.time_ns, raising=False)
    way.receive(2, at_ns=real())
    assert way.way.losses == {}


class Entry:
    def __init__(self) -> None:
        self.last = self.newest_ns = -1
        self.listeners: frozenset[bytes] = frozenset()
        self.ends = 0

    def note(self, last: int, newest_ns: int) -> None:
        self.last, self.newest_ns = last, newest_ns

    def note_listeners(self, gids: frozenset[bytes]) -> None:
        self.listeners = gids

    def end(self) -> None:
        self.ends += 1


async def test_it_notes_what_it_has_published_and_for_whom() -> None:
    way = Way(LOSSLESS)
    entry: Any = Entry()
    way.way.entry = entry
    way.publisher.room = 3
    way.receive(1, 2, 3, 4, 5, at_ns=2_000)
    assert (entry.last, entry.newest_ns, entry.listeners) == (3, 2_000, {LISTENER})
    way.match(LISTENER, OTHER)
    assert entry.listeners == {LISTENER}, "the other one has received none yet"
    await asyncio.sleep(0)  # it waits for room
    way.publisher.give_room(10)
    await until(lambda: not way.way.waiting)
    assert entry.last == 5
    way.receive(6)
    assert (entry.last, entry.listeners) == (6, {LISTENER, OTHER})
    way.way.end()
    assert entry.ends == 0, "the bridge ends: the notes are for the next process"


async def test_what_is_not_lossless_is_noted_first() -> None:
    way = Way()
    entry: Any = Entry()
    way.way.entry = entry
    way.publisher.error = KeyboardInterrupt()  # type: ignore[assignment]  # as a kill
    with pytest.raises(KeyboardInterrupt):
        way.receive(1)
    assert entry.last == 1


async def test_the_notes_end_with_the_publisher_or_with_its_numbers() -> None:
    way = Way()
    entry: Any = Entry()
    way.way.entry = entry
    way.receive(1)
    await way.way.finish()
    assert entry.ends == 1
    way = Way()
    way.way.entry = entry
    way.way.begin_again(way.endpoint, numbering="another mirror")
    assert entry.ends == 2
    way.receive(1)
    assert entry.last == 1
