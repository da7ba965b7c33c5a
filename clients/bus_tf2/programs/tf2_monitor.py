"""`bus run tf2_ros tf2_monitor`: how late transforms are, and how often they come.

Owns: the counts (`Counts`, pure), the output, and how often it is printed.
"""

import sys
from collections import deque
from collections.abc import Iterable, Sequence
from threading import Lock

import bus_ros.rclpy as rclpy
from bus.base.printable import printable
from bus_ros.rclpy.clock import Clock, ClockType
from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import DurabilityPolicy, QoSProfile
from bus_ros.rclpy.time import Time
from bus_tf2.messages import message_type
from bus_tf2.programs.shell import begun, own_words
from bus_tf2.tf2_ros import Buffer, TransformException, TransformListener

__all__ = ["Counts", "main", "run"]

_KEPT = 1000
_NOBODY = "<no authority available>"
_PERIOD_S = 0.5
_ROUNDS = 20


class Counts:
    """Delays of the last thousand transforms of each frame, and the times of the last thousand messages, in
    seconds.
    """

    def __init__(self) -> None:
        self.delays: dict[str, deque[float]] = {}
        self.averages: deque[float] = deque(maxlen=_KEPT)
        self.arrivals: deque[float] = deque(maxlen=_KEPT)

    def add(self, now_s: float, stamps: Iterable[tuple[str, float]]) -> None:
        """A message: of each of its transforms the child frame and the stamp."""
        delays = []
        for frame, stamp_s in stamps:
            delays.append(now_s - stamp_s)
            self.delays.setdefault(frame, deque(maxlen=_KEPT)).append(delays[-1])
        self.averages.append(sum(delays) / max(1, len(delays)))
        self.arrivals.append(now_s)

    def lines(self, frames: Sequence[str] | None = None) -> list[str]:
        """`frames`: only of these."""
        said = ["Frames:"]
        for frame in sorted(self.delays):
            if frames is None or frame in frames:
                name = printable(frame, keep="")
                said.append(f"Frame: {name}, published by {_NOBODY}, {_average(self.delays[frame])}")
        said += ["", "All Broadcasters:"]
        if self.arrivals:
            length_s = max(1e-8, self.arrivals[-1] - self.arrivals[0])
            said.append(f"Node: {_NOBODY} {len(self.arrivals) / length_s:g} Hz, {_average(self.averages)}")
        return said


def _average(delays: Sequence[float]) -> str:
    return f"Average Delay: {sum(delays) / len(delays):g}, Max Delay: {max(0.0, *delays):g}"


def main() -> int:
    return run(own_words())


def run(words: Sequence[str]) -> int:
    """Watch until an interrupt; returns an exit status."""
    if len(words) not in (0, 2):
        print("TF_Monitor: usage: tf2_monitor framea frameb", file=sys.stderr)
        return 1
    with begun():
        _watch(*words)
    return 0


def _watch(to: str = "", of: str = "") -> None:
    node = Node("tf2_monitor_main")
    buffer, counts, lock = Buffer(node=node), Counts(), Lock()
    clock = Clock(clock_type=ClockType.STEADY_TIME)

    def on_message(message: object) -> None:
        now_s = node.get_clock().now().nanoseconds / 1e9
        transforms = getattr(message, "transforms", ())
        with lock:
            counts.add(
                now_s,
                [
                    (one.child_frame_id, one.header.stamp.sec + one.header.stamp.nanosec / 1e9)
                    for one in transforms
                ],
            )

    kind = message_type("tf2_msgs/msg/TFMessage")
    node.create_subscription(kind, "/tf", on_message, 100)
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(kind, "/tf_static", on_message, latched)
    listener = TransformListener(buffer, node, spin_thread=True)
    chain: list[str] | None = None
    if to:
        print(f"Waiting for transform chain to become available between {to} and {of} ", end="", flush=True)
        while rclpy.ok() and not buffer.can_transform(to, of, Time(), Duration(seconds=1.0)):
            print(".", end="", flush=True)
        print(flush=True)
        if not rclpy.ok():  # SIGTERM came first
            listener.unregister()
            return
        chain = buffer._chain(to, Time(), of, Time(), to)
    print(f"Gathering data on {f'{to} -> {of}' if to else 'all frames'} for 10 seconds...", flush=True)
    average_s = most_s = 0.0
    rounds = 0
    while rclpy.ok():
        rounds += 1
        if to:
            late_s = _lateness(buffer, node, to, of)
            average_s = 0.01 * late_s + 0.99 * average_s
            most_s = max(most_s, late_s)
        clock.sleep_for(Duration(seconds=_PERIOD_S))
        if rounds > _ROUNDS:
            rounds = 0
            said = ["", "", "", f"RESULTS: for {f'{to} to {of}' if to else 'all Frames'}"]
            if chain is not None:
                said += [
                    f"Chain is: {printable(' -> '.join(chain), keep='')}",
                    f"Net delay     avg = {average_s:g}: max = {most_s:g}",
                ]
            with lock:
                said += ["", *counts.lines(chain)]
            print("\n".join(said), flush=True)
    listener.unregister()


def _lateness(buffer: Buffer, node: Node, to: str, of: str) -> float:
    """The age of the transform between the two, in seconds; 0 if it is static, or gone."""
    try:
        stamp = buffer.lookup_transform(to, of, Time()).header.stamp
    except TransformException:
        return 0.0
    stamp_s = stamp.sec + stamp.nanosec / 1e9
    return float(node.get_clock().now().nanoseconds / 1e9 - stamp_s) if stamp_s else 0.0
