"""A bag on the page: requests to a real player, its states, and the recorded losses."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from bus.logger import get_logger
from bus_bag import losses
from bus_bag.errors import BagError
from bus_bag.losses import TopicLosses
from bus_bag.page import PlayerControl, recorded_losses, recording_of
from bus_bag.play.options import PlayOptions
from bus_bag.play.player import Player, Span
from bus_bag.play.read_ahead import ReadAheadQueue
from bus_bag.play.selection import Selection
from bus_bag.storage import BagMessage, JoinedBags
from bus_plot.loss_timeline import Slot
from bus_web.playback import Recording, Request, State, Status
from semantics import until

S = 1_000_000_000


class Reader:
    """A bag of one topic with a message in each second, up to second 9."""

    def messages(self, start: int | None, topics: Any, by: str) -> Iterator[BagMessage]:
        for number in range(10):
            if number * S >= (start or 0):
                yield BagMessage("/a", number * S, 0, 0, bytes([number]))


class Output:
    def __init__(self) -> None:
        self.taken: list[int] = []

    def publish_encoded(self, payload: bytes, *, source_time_ns: int | None = None) -> bool:
        self.taken.append(payload[0])
        return True

    async def wait_for_room(self) -> None: ...


@asynccontextmanager
async def control(output: Output) -> AsyncIterator[PlayerControl]:
    queue = ReadAheadQueue(cast(Any, Reader()), frozenset({"/a"}), {}, lambda one: bytes(one.data))
    options = PlayOptions(selection=Selection(), is_paused=True, stays_at_end=True)
    span = Span(0, 9 * S, True)
    try:
        async with Player(queue, {"/a": output}, span, options, get_logger("player")) as player:
            playing = asyncio.create_task(player.play())
            yield PlayerControl(player, Recording("walk", 0, 9 * S, None))
            player.stop()
            await playing
    finally:
        queue.close()


async def test_all_requests() -> None:
    output = Output()
    async with control(output) as walk:
        assert await walk.ask(Request(step=True)) == ""
        assert (output.taken, walk.state.status, walk.state.messages) == ([0], Status.PAUSED, 1)
        assert await walk.ask(Request(seek_ns=5 * S, rate=100.0)) == ""
        assert (walk.state.at_ns, walk.state.rate) == (5 * S, 100.0) and walk.state.seeks == 1
        assert await walk.ask(Request(is_paused=False)) == ""
        await until(lambda: walk.state.status is Status.AT_END)
        assert output.taken == [0, 5, 6, 7, 8, 9] and walk.state.at_ns == 9 * S
        jumps: list[State] = []
        assert await walk.ask(Request(is_paused=False), lambda: jumps.append(walk.state)) == ""
        # from the beginning again: no longer at its end
        assert jumps == [State(Status.READING, False, 0, 100.0, 6, 2)]
        await until(lambda: len(output.taken) == 16)
        assert output.taken[6:] == [*range(10)]


async def test_at_the_jump_the_other_wishes_are_done() -> None:
    output = Output()
    async with control(output) as walk:
        jumps: list[State] = []

        async def ask(is_paused: bool, rate: float, seek_ns: int) -> None:
            request = Request(is_paused=is_paused, rate=rate, seek_ns=seek_ns)
            assert await walk.ask(request, lambda: jumps.append(walk.state)) == ""

        await ask(False, 0.001, 5 * S)
        assert (walk.state.status, walk.state.at_ns // S) == (Status.PLAYING, 5)
        await ask(True, 1e9, 2 * S)
        await ask(False, 1e9, 8 * S)
        assert [(one.status, one.is_paused, one.rate, one.at_ns) for one in jumps] == [
            (Status.READING, False, 0.001, 5 * S),
            (Status.PAUSED, True, 1e9, 2 * S),
            (Status.READING, False, 1e9, 8 * S),
        ]
        await until(lambda: walk.state.status is Status.AT_END)
        assert [one for one in output.taken if one != 5] == [8, 9], "nothing at the new rate before a jump"
        await ask(True, 1.0, 3 * S)
        assert (jumps[-1].status, jumps[-1].at_ns) == (Status.PAUSED, 3 * S)


async def test_a_request_with_a_rate_that_is_refused_changes_nothing() -> None:
    async with control(Output()) as walk:
        assert await walk.ask(Request(seek_ns=5 * S, rate=0.001)) == ""
        for is_paused in (True, False):
            assert await walk.ask(Request(is_paused=is_paused)) == ""
            before = walk.state._replace(at_ns=0)
            for rate in (0.0, -1.0, float("nan")):
                request = Request(rate=rate, is_paused=not is_paused, seek_ns=0, step=True)
                assert await walk.ask(request) == f"{rate:g} is not a rate from 1e-9 to 1e9"
            assert walk.state.at_ns >= 5 * S and walk.state._replace(at_ns=0) == before


async def test_refusals() -> None:
    output = Output()
    async with control(output) as walk:
        for rate in (0.0, -1.0, 1e300, 1e-300, float("nan"), float("inf")):
            assert await walk.ask(Request(rate=rate)) == f"{rate:g} is not a rate from 1e-9 to 1e9"
        assert await walk.ask(Request(seek_ns=1 << 70)) == ""  # the end is the farthest
        assert walk.state.at_ns == 9 * S
        assert await walk.ask(Request(seek_ns=-5, is_paused=False, step=True)) == (
            "only a paused bag can be played by steps"
        )
        assert await walk.ask(Request(seek_ns=9 * S, is_paused=True, step=True)) == ""
        assert await walk.ask(Request(step=True)) == "no next message"
    assert await walk.ask(Request(seek_ns=0)) == "the bag is no longer played"


async def test_a_client_hears_of_a_jump_before_the_messages_from_there() -> None:
    output = Output()
    async with control(output) as walk:
        heard: list[tuple[str, int, int, list[int]]] = []

        def note(who: str) -> None:
            heard.append((who, walk.state.seeks, walk.state.at_ns, [*output.taken]))

        assert await walk.ask(Request(step=True)) == ""
        with walk.watching(lambda: note("all")):
            heard.clear()
            assert await walk.ask(Request(seek_ns=5 * S, step=True), lambda: note("one")) == ""
            assert heard[:2] == [("one", 1, 5 * S, [0]), ("all", 1, 5 * S, [0])]
            assert output.taken == [0, 5]


async def test_requests_at_once_are_done_in_their_order() -> None:
    async with control(Output()) as walk:
        asked = [walk.ask(Request(seek_ns=number * S, is_paused=bool(number % 2))) for number in (0, 9, 2, 3)]
        await asyncio.gather(*asked)
        assert (walk.state.at_ns, walk.state.status) == (3 * S, Status.PAUSED)


async def test_watchers_hear_of_changes_by_whatever_they_are_made() -> None:
    async with control(Output()) as walk:
        await until(lambda: walk.state.status is Status.PAUSED)
        heard: list[Status] = []
        with walk.watching(lambda: heard.append(walk.state.status)):
            walk._player.resume()  # as a key or a service does
            await until(lambda: Status.PLAYING in heard)
        count = len(heard)
        assert walk._polling is None
        walk._player.pause()
        assert len(heard) == count


def bags(*records: dict[str, TopicLosses] | None, messages: int = 1) -> JoinedBags:
    readers = [
        SimpleNamespace(
            files=[
                SimpleNamespace(records=[] if record is None else [(losses.RECORD, losses.to_record(record))])
            ]
        )
        for record in records
    ]
    joined = SimpleNamespace(readers=readers, message_count=messages, starting_time=S, duration=2 * S)
    return cast(JoinedBags, joined)


def test_recorded_losses() -> None:
    imu = TopicLosses(
        10, 7, lost={"replaced": 3}, when=[Slot(4, 1, {"replaced": 2})], earlier={"replaced": 1}
    )
    assert recorded_losses(bags(None)) is None
    assert recorded_losses(bags({"/imu": TopicLosses(5, 5)})) == {}
    found = recorded_losses(bags({"/imu": imu, "/scan": TopicLosses(5, 5)}))
    assert found is not None and found.keys() == {"/imu"}
    assert (found["/imu"].lost, found["/imu"].expected) == (3, 10)
    assert found["/imu"].timeline.lost == {"replaced": 3}


def test_losses_of_several_bags_add_up() -> None:
    one = TopicLosses(10, 9, lost={"replaced": 1}, when=[Slot(4, 1, {"replaced": 1})])
    other = TopicLosses(
        20, 18, lost={"replaced": 2}, when=[Slot(8, 1, {"replaced": 1})], earlier={"replaced": 1}
    )
    found = recorded_losses(bags({"/imu": one}, None, {"/imu": other}))
    assert found is not None
    imu = found["/imu"]
    assert (imu.lost, imu.expected, imu.timeline.total) == (3, 30, 3)
    assert [slot.at_s for slot in imu.timeline.slots()] == [4, 8] and imu.timeline.earlier == {"replaced": 1}


def test_mistakes_get_one_line() -> None:
    broken = TopicLosses(10, 9, lost={"replaced": 1}, when=[Slot(4, 3, {"replaced": 1})])
    with pytest.raises(BagError, match=r"^the record of losses of '/imu' is broken: no slot of a timeline"):
        recorded_losses(bags({"/imu": broken}))
    with pytest.raises(BagError, match=r"^Nothing to play: walk \+ run has no messages$"):
        recording_of(bags(None, messages=0), [Path("/tmp/walk"), Path("run")])
    found = recording_of(bags(None), [Path("/tmp/walk")])
    assert found == Recording("walk", S, 3 * S, None)
    found = recording_of(bags({"/imu": broken}), [Path("/tmp/walk")])
    assert (found.losses, found.fault.partition(":")[0]) == (None, "the record of losses of '/imu' is broken")
