"""message_filters: the output of each filter, the messages that it keeps, and refusals."""

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from bus_ros.message_filters import ApproximateTimeSynchronizer, Cache, Chain, SimpleFilter, TimeSynchronizer
from bus_ros.rclpy.time import ClockType, Time


def at(seconds: float, name: str = "") -> Any:
    stamp = Time(nanoseconds=round(seconds * 1e9), clock_type=ClockType.ROS_TIME)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp), name=name)


def two() -> tuple[SimpleFilter, SimpleFilter]:
    return SimpleFilter(), SimpleFilter()


def collected(source: SimpleFilter) -> list[Any]:
    out: list[Any] = []
    source.registerCallback(lambda *messages: out.append(messages))
    return out


def test_callbacks_get_their_own_arguments_last() -> None:
    source, heard = SimpleFilter(), []
    assert [source.registerCallback(lambda *args: heard.append(args), *own) for own in ((1, 2), ())] == [0, 1]
    source.signalMessage("a", "b")
    assert heard == [("a", "b", 1, 2), ("a", "b")]


def test_a_callback_may_register_another() -> None:
    source = SimpleFilter()
    source.registerCallback(lambda _: source.registerCallback(print))
    source.signalMessage("a")
    assert len(source.callbacks) == 2


def test_sets_of_one_stamp() -> None:
    left, right = two()
    out = collected(TimeSynchronizer([left, right], 10))
    first, second = at(1), at(2)
    left.signalMessage(first)
    left.signalMessage(second)
    twin = at(2)
    right.signalMessage(twin)
    assert out == [(second, twin)]
    late = at(1)
    right.signalMessage(late)  # its partner is older than the last output, and still waits
    assert out == [(second, twin), (first, late)]


def test_a_full_queue_forgets_the_oldest() -> None:
    left, right = two()
    synchronizer = TimeSynchronizer([left, right], 2)
    out = collected(synchronizer)
    for seconds in (3, 1, 2):
        left.signalMessage(at(seconds))
    assert [len(queue) for queue in synchronizer.queues] == [2, 0]
    right.signalMessage(at(1))
    assert out == []
    right.signalMessage(at(2))
    assert len(out) == 1


def test_a_callback_that_raises_or_puts_in_more_does_not_stop_the_rest() -> None:
    left, right = two()
    synchronizer = TimeSynchronizer([left, right], 2)
    out: list[float] = []

    def heard(one: Any, other: Any) -> None:
        out.append(one.header.stamp.nanoseconds)
        if len(out) == 1:
            left.signalMessage(at(2))
            right.signalMessage(at(2))
            raise ValueError("no")

    synchronizer.registerCallback(heard)
    left.signalMessage(at(1))
    with pytest.raises(ValueError, match="no"):
        right.signalMessage(at(1))
    thread = threading.Thread(target=left.signalMessage, args=(at(3),), daemon=True)
    thread.start()
    thread.join(30)
    right.signalMessage(at(3))
    assert out == [1e9, 2e9, 3e9]


def test_nearly_one_stamp() -> None:
    left, right = two()
    out = collected(ApproximateTimeSynchronizer([left, right], 10, 0.1))
    one, other = at(1.0), at(1.05)
    left.signalMessage(one)
    right.signalMessage(at(1.2))
    assert out == []
    right.signalMessage(other)
    assert out == [(one, other)]


@pytest.mark.parametrize("option", [{"allow_headerless": True}, {"sync_arrival_time": True}])
def test_the_time_of_arrival(option: dict[str, bool]) -> None:
    left, right = two()
    out = collected(ApproximateTimeSynchronizer([left, right], 10, 1000.0, **option))
    left.signalMessage("one")
    right.signalMessage("other")
    assert out == [("one", "other")]


def test_messages_without_a_stamp(capsys: pytest.CaptureFixture[str]) -> None:
    left, right = two()
    approximate = ApproximateTimeSynchronizer([left, right], 10, 0.1)
    left.signalMessage("one")
    assert (
        "[message_filters_approx]: can not use message filters for messages without timestamp infomation "
        "when 'allow_headerless' is disabled. auto assign ROSTIME to headerless messages once enabling "
        "constructor option of 'allow_headerless'."
    ) in capsys.readouterr().err
    assert approximate.queues == [{}, {}]
    source = SimpleFilter()
    cache = Cache(source)
    source.signalMessage("one")
    assert "[message_filters_cache]: can not use message filters messages without" in capsys.readouterr().err
    assert cache.getLast() is None
    TimeSynchronizer([left, right], 10)
    with pytest.raises(AttributeError, match=r"str has no header\.stamp: it can't be synchronized by time"):
        right.signalMessage("one")


def test_a_queue_holds_something() -> None:
    with pytest.raises(ValueError, match="queue_size must be at least 1, not 0"):
        TimeSynchronizer([SimpleFilter()], 0)


def time(seconds: float) -> Time:
    stamp: Time = at(seconds).header.stamp
    return stamp


def test_a_cache_keeps_the_last_by_arrival() -> None:
    source = SimpleFilter()
    cache = Cache(source, 3)
    out = collected(cache)
    messages = [at(seconds, name) for seconds, name in ((9, "gone"), (1, "a"), (4, "b"), (3, "c"))]
    for message in messages:
        source.signalMessage(message)
    assert out == [(message,) for message in messages]
    assert [one.name for one in cache.cache_msgs] == ["a", "b", "c"]
    assert cache.cache_times == [time(1), time(4), time(3)]
    assert (cache.getOldestTime(), cache.getLatestTime(), cache.getLastestTime()) == (
        time(1),
        time(3),
        time(3),
    )
    assert [one.name for one in cache.getInterval(time(1), time(3))] == ["a", "c"]
    assert cache.getElemAfterTime(time(3)).name == "b"
    assert cache.getElemBeforeTime(time(3.5)).name == "c"
    assert cache.getLast().name == "b"
    assert cache.getElemAfterTime(time(5)) is None
    assert cache.getElemBeforeTime(time(0.5)) is None
    with pytest.raises(AssertionError, match="before it begins"):
        cache.getInterval(time(2), time(1))


def test_an_empty_cache() -> None:
    cache = Cache(SimpleFilter(), 3, allow_headerless=True)
    assert (cache.getLast(), cache.getOldestTime(), cache.getLatestTime()) == (None, None, None)
    assert cache.getInterval(time(0), time(9)) == []
    cache.add("headerless")
    assert cache.getLast() == "headerless"


def test_a_chain() -> None:
    source = SimpleFilter()
    chain = Chain(source)
    out = collected(chain)
    source.signalMessage(at(1, "through"))
    caches = [Cache(SimpleFilter(), size) for size in (2, 1)]
    for cache in caches:
        chain.addFilter(cache)
    for seconds in (2, 3):
        source.signalMessage(at(seconds, str(seconds)))
    assert [one.name for (one,) in out] == ["through", "2", "3"]
    assert [[one.name for one in cache.cache_msgs] for cache in caches] == [["2", "3"], ["3"]]
    assert chain.getFilter(1) is caches[1]
    with pytest.raises(KeyError):
        chain.getFilter(2)
    with pytest.raises(RuntimeError, match="Already connected"):
        chain.connectInput(source)
