"""busd with std_msgs/String by the API for scripts (`bus.connect`): no event loop, each call blocks."""

import gc
import signal
import sys
from collections.abc import Coroutine
from typing import Any

import msgspec
from msgspec.structs import replace

import bus
from benchmarks.adapters.bus_string import qos_of
from benchmarks.adapters.roles import Stamps
from benchmarks.work import Work, pace
from benchmarks.worker import LIFE_S, options, tell
from bus.msg.std_msgs import String


def publisher() -> None:
    work: Work = options(Work)
    with bus.connect("bench_publisher") as node:
        publisher = node.create_publisher(String, work.topic, qos_of(work))
        publisher.wait_for_subscriptions(work.subscribers)
        tell("ready", route=publisher.matches[0].route)
        _expect("go")
        _complete(pace(lambda text: publisher.publish(String(data=text)), replace(work, gives_turns=False)))
        _end()


def subscriber() -> None:
    work: Work = options(Work)
    stamps = Stamps(work)
    with bus.connect("bench_subscriber") as node:
        subscription = node.create_subscription(String, work.topic, qos_of(work))
        tell("ready")
        for message in subscription:
            if stamps.note(message.data):
                break
        if dropped := subscription.statistics().dropped:
            raise RuntimeError(f"lost: {dropped}")
        tell("complete")
        _expect("report")
        tell("received", **msgspec.to_builtins(stamps.arrivals()))
        _end()


def _complete(coroutine: Coroutine[Any, Any, None]) -> None:
    """Run a coroutine that never waits."""
    try:
        coroutine.send(None)
    except StopIteration:
        return
    raise RuntimeError("it would wait for an event loop")


def _expect(word: str) -> None:
    if (came := sys.stdin.readline().strip()) != word:
        sys.exit(f"expected the word {word!r}, got {came!r}" if came else 0)


def _end() -> None:
    """Wait until the parent closes stdin."""
    sys.stdin.read()


if __name__ == "__main__":
    signal.alarm(LIFE_S)
    gc.freeze()  # as in `benchmarks.worker.run`
    {"publisher": publisher, "subscriber": subscriber}[sys.argv[1]]()
