"""bus.link.reports: the times of reports, a few endpoints at a time. The test sets the loop's time."""

from typing import Any

import pytest

from bus.link.reports import Reports
from bus.wire import messages as m
from bus.wire.framing import FrameReader
from bus.wire.layout import MAX_CONTROL_BYTES


class _Timer:
    def __init__(self, action: Any) -> None:
        self.action = action

    def cancel(self) -> None:
        self.action = None


class _Loop:
    """Time passes only by `fire`."""

    def __init__(self) -> None:
        self.timers: list[_Timer] = []

    def call_later(self, delay_s: float, action: Any) -> _Timer:
        self.timers.append(_Timer(action))
        return self.timers[-1]

    def fire(self) -> None:
        (timer,) = self.timers
        self.timers.clear()
        timer.action()


class _Endpoint:
    refusal = None

    def __init__(self, number: int, queued: int = 0) -> None:
        self.id = number
        self.queued = queued

    def totals(self) -> m.Report:
        return m.Report(endpoint=self.id, samples=1, bytes=2, queued=self.queued)


class _World:
    def __init__(self) -> None:
        self.loop = _Loop()
        self.batches: list[list[int]] = []
        self.reports = Reports(self.loop, self._send)  # type: ignore[arg-type]

    def _send(self, endpoint: Any, frames: bytes) -> None:
        if not frames:
            return
        assert endpoint.id
        reader = FrameReader(max_control_bytes=MAX_CONTROL_BYTES, max_data_bytes=0)
        reader.get_buffer()[: len(frames)] = frames
        bodies: list[Any] = reader.received(len(frames))
        while not reader.is_cut:
            bodies += reader.cut()
        self.batches.append([m.from_client.decode(body).endpoint for body in bodies])


@pytest.fixture
def world() -> _World:
    return _World()


def _told(world: _World) -> list[int]:
    return sorted(number for batch in world.batches for number in batch)


def test_many_are_told_some_at_a_time_and_each_once(world: _World) -> None:
    many: list[Any] = [_Endpoint(number) for number in range(1, 201)]
    world.reports.add_all(many)
    assert not world.batches

    while world.loop.timers:
        world.loop.fire()

    assert _told(world) == list(range(1, 201))
    assert len(world.batches) > 2
    assert max(map(len, world.batches)) < 100


def test_what_changes_while_others_are_told_waits_for_the_next_turn(world: _World) -> None:
    many: list[Any] = [_Endpoint(number) for number in range(1, 201)]
    world.reports.add_all(many)
    world.loop.fire()
    world.reports.add_all(many[:3])
    while len(_told(world)) < 200:
        world.loop.fire()
    assert _told(world) == list(range(1, 201))

    world.loop.fire()

    assert sorted(world.batches[-1]) == [1, 2, 3]
    assert not world.loop.timers


def test_who_goes_is_told_of_at_once_and_no_more(world: _World) -> None:
    many: list[Any] = [_Endpoint(number) for number in range(1, 201)]
    world.reports.add_all(many)
    world.loop.fire()
    last = next(one for one in many if one.id not in world.batches[0])
    world.reports.send_last(last)
    assert world.batches[-1] == [last.id]

    while world.loop.timers:
        world.loop.fire()

    assert _told(world) == list(range(1, 201))


def test_the_end_tells_the_rest_and_nothing_more(world: _World) -> None:
    many: list[Any] = [_Endpoint(number) for number in range(1, 201)]
    world.reports.add_all(many)
    world.loop.fire()

    world.reports.end()
    world.reports.add(many[0])

    assert _told(world) == list(range(1, 201))
    assert all(timer.action is None for timer in world.loop.timers)


def test_what_is_queued_is_told_again_and_what_the_broker_does_not_know_is_not(world: _World) -> None:
    waiting: Any = _Endpoint(1, queued=5)
    unknown: Any = _Endpoint(0)
    world.reports.add_all([waiting, unknown])

    world.loop.fire()
    waiting.queued = 0
    world.loop.fire()

    assert world.batches == [[1], [1]]
    assert not world.loop.timers


def test_one_that_goes_while_the_others_are_counted_is_not_told(world: _World) -> None:
    """busd no longer knows that endpoint, and would treat the report as a protocol error."""
    leaving = _Endpoint(1)

    class Closing(_Endpoint):
        def totals(self) -> m.Report:
            found = super().totals()
            leaving.id = 0
            return found

    both: list[Any] = [leaving, Closing(2)]
    world.reports.add_all(both)
    world.loop.fire()

    assert _told(world) == [2]


def test_what_can_not_be_counted_keeps_nobody_from_being_told(world: _World) -> None:
    class Broken(_Endpoint):
        fails = True

        def totals(self) -> m.Report:
            if self.fails:
                raise MemoryError
            return super().totals()

    broken = Broken(1)
    some: list[Any] = [broken, _Endpoint(2), _Endpoint(3)]
    world.reports.add_all(some)
    with pytest.raises(MemoryError):
        world.loop.fire()
    broken.fails = False
    while world.loop.timers:
        world.loop.fire()

    assert set(_told(world)) == {1, 2, 3}
