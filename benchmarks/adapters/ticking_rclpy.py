"""A program of rclpy with a periodic timer, in `rclpy.spin`. It does not use busd directly."""

import signal
import sys
from time import monotonic_ns

import rclpy

from benchmarks.ticks import Ticks, Watch
from benchmarks.worker import LIFE_S, options, tell


class _Done(Exception):
    """Raised in a callback to leave `spin`."""


def _main() -> None:
    ticks: Ticks = options(Ticks)
    signal.alarm(LIFE_S)
    rclpy.init(args=[])
    node = rclpy.create_node("ticker")

    def tick() -> None:
        if watch.note():
            raise _Done

    timer = node.create_timer(1 / ticks.rate, tick)
    watch = Watch(ticks, monotonic_ns() + timer.time_until_next_call())
    try:
        rclpy.spin(node)
    except _Done:
        tell("called", **watch.calls())
    sys.stdin.read()  # until the parent ends it


if __name__ == "__main__":
    _main()
