"""Openings: the publishers that hold their messages while a subscription to their topic is opening."""

import asyncio
from collections.abc import Iterator

import pytest

from bus_ros.rclpy.impl.openings import Openings


class Publisher:
    def __init__(self) -> None:
        self.holds = 0

    def hold(self) -> None:
        self.holds += 1

    def release(self) -> None:
        self.holds -= 1


@pytest.fixture
def loop() -> Iterator[asyncio.AbstractEventLoop]:
    loop = asyncio.new_event_loop()
    yield loop
    loop.close()


def test_publishers_of_the_topic_hold_until_all_subscriptions_are_open(
    loop: asyncio.AbstractEventLoop,
) -> None:
    openings = Openings.of(loop)
    early, late, other = Publisher(), Publisher(), Publisher()
    openings.add_publisher("/a", early)
    openings.add_publisher("/b", other)
    openings.begin("/a")
    openings.begin("/a")
    openings.add_publisher("/a", late)
    assert (early.holds, late.holds, other.holds) == (2, 2, 0)
    openings.end("/a")
    assert (early.holds, late.holds) == (1, 1)
    openings.end("/a")
    assert (early.holds, late.holds) == (0, 0)
    after = Publisher()
    openings.add_publisher("/a", after)
    assert after.holds == 0


def test_a_removed_publisher_is_left_alone(loop: asyncio.AbstractEventLoop) -> None:
    openings = Openings.of(loop)
    publisher = Publisher()
    openings.add_publisher("/a", publisher)
    openings.remove_publisher("/a", publisher)
    openings.remove_publisher("/a", publisher)
    openings.begin("/a")
    openings.end("/a")
    assert publisher.holds == 0


def test_each_loop_has_its_own(loop: asyncio.AbstractEventLoop) -> None:
    openings = Openings.of(loop)
    assert Openings.of(loop) is openings
    other = asyncio.new_event_loop()
    try:
        assert Openings.of(other) is not openings
    finally:
        other.close()
