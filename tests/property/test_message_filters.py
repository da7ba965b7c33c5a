"""Synchronizers against a model that tries every set, for any messages in any order."""

import itertools
from types import SimpleNamespace
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from bus_ros.message_filters import ApproximateTimeSynchronizer, SimpleFilter, TimeSynchronizer
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.time import Time
from effort import examples

Set = tuple[tuple[int, int], ...]
arrivals = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 40)), max_size=40)


class Model:
    """The rules of ROS 2's documentation, without any optimization."""

    def __init__(self, inputs: int, queue_size: int) -> None:
        self.queues: list[dict[int, Any]] = [{} for _ in range(inputs)]
        self.queue_size = queue_size

    def put(self, index: int, stamp: int, name: int) -> None:
        self.queues[index][stamp] = name
        while len(self.queues[index]) > self.queue_size:
            del self.queues[index][min(self.queues[index])]

    def take(self, stamps: tuple[int, ...]) -> Set:
        return tuple((stamp, queue.pop(stamp)) for stamp, queue in zip(stamps, self.queues, strict=True))

    def exact(self, index: int, stamp: int, name: int) -> list[Set]:
        self.put(index, stamp, name)
        common = set.intersection(*map(set, self.queues))
        return [self.take((one,) * len(self.queues)) for one in sorted(common)]

    def approximate(self, index: int, stamp: int, name: int, slop: int) -> list[Set]:
        self.put(index, stamp, name)
        near = [
            sorted((one for one in queue if abs(one - stamp) <= slop), key=lambda one: abs(one - stamp))
            for queue in self.queues
        ]
        near[index] = [one for one in near[index] if one == stamp]
        for stamps in itertools.product(*near):
            if max(stamps) - min(stamps) < slop:
                return [self.take(stamps)]
        return []


def run(make: Any, model: Any, inputs: int, came: list[tuple[int, int]]) -> None:
    filters = [SimpleFilter() for _ in range(inputs)]
    synchronizer = make(filters)
    out: list[Set] = []
    synchronizer.registerCallback(
        lambda *messages: out.append(tuple((one.header.stamp.nanoseconds, one.name) for one in messages))
    )
    for name, (index, stamp) in enumerate(came):
        out.clear()
        message = SimpleNamespace(header=SimpleNamespace(stamp=Time(nanoseconds=stamp)), name=name)
        filters[index % inputs].signalMessage(message)
        assert out == model(index % inputs, stamp, name)
        assert all(len(queue) <= synchronizer.queue_size for queue in synchronizer.queues)


@settings(max_examples=examples(400))
@given(st.integers(1, 4), st.integers(1, 6), arrivals)
def test_exactly(inputs: int, queue_size: int, came: list[tuple[int, int]]) -> None:
    run(lambda fs: TimeSynchronizer(fs, queue_size), Model(inputs, queue_size).exact, inputs, came)


@settings(max_examples=examples(800))
@given(st.integers(1, 4), st.integers(1, 6), st.integers(0, 15), arrivals)
def test_approximately(inputs: int, queue_size: int, slop: int, came: list[tuple[int, int]]) -> None:
    model = Model(inputs, queue_size)

    def make(filters: list[SimpleFilter]) -> ApproximateTimeSynchronizer:
        synchronizer = ApproximateTimeSynchronizer(filters, queue_size, 1.0)
        synchronizer.slop = Duration(nanoseconds=slop)  # seconds would be rounded
        return synchronizer

    run(
        make,
        lambda index, stamp, name: model.approximate(index, stamp, name, slop),
        inputs,
        came,
    )
