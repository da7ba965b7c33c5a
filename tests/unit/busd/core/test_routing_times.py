"""busd.core.routing_times: the histogram of the times that runs stay in busd."""

from broker_world import Process, World
from bus.wire import messages as m
from busd.core.routing_times import BOUNDS_US, RoutingTimes
from rows import for_each


@for_each(
    ("elapsed_ns", "bucket"),
    [
        (0, 0),
        (999, 0),
        (3_999, 0),
        (4_000, 1),
        (15_999, 1),
        (16_000, 2),
        (999_999_999, 9),
        (4**10 * 1000 - 1, 9),
        (4**10 * 1000, 10),
        (3_600_000_000_000, 10),
    ],
)
def test_where_a_read_is_counted(elapsed_ns: int, bucket: int) -> None:
    times = RoutingTimes()
    times.add(1, elapsed_ns)
    counts = times.record(samples=0, bytes=0).counts
    assert [at for at, count in enumerate(counts) if count] == [bucket]
    if bucket < len(BOUNDS_US):
        assert elapsed_ns <= BOUNDS_US[bucket] * 1000
    if bucket:
        assert elapsed_ns >= BOUNDS_US[bucket - 1] * 1000


def test_what_is_told() -> None:
    times = RoutingTimes()
    times.add(3, 5_500)
    times.add(1, 20_000)
    record = times.record(samples=40, bytes=1000)
    assert (record.runs, record.samples, record.bytes, record.total_us) == (4, 40, 1000, 25)
    assert record.bounds_us == BOUNDS_US
    assert sum(record.counts) == 2
    assert len(record.counts) == len(BOUNDS_US) + 1


def routed(process: Process) -> tuple[int, int]:
    """Samples and bytes that the broker routed, from its own statistics."""
    routing = process.request(m.GetPeers(request=0), m.Peers).routing
    return routing.samples, routing.bytes


def test_publishers_that_have_left_still_count() -> None:
    world = World()
    talker, listener = world.process(), world.process()
    assert routed(listener) == (0, 0)
    publisher = talker.publisher("/topic")
    publisher.publish("a", "bcd")
    assert routed(listener) == (2, 4)
    other = talker.publisher("/other")
    other.publish("x")
    publisher.destroy()
    assert routed(listener) == (3, 5)
    talker.die()
    assert routed(listener) == (3, 5)
