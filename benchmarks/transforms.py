"""The time of a look-up of a transform: a chain of six frames, each with ten seconds at 100 Hz.

    python -m benchmarks.transforms

Prints microseconds, the best of several rounds: with the native core, with its Python twin, and with the tf2
of ROS 1, whose core is C++, if Debian's python3-tf2 is installed. It is not part of the benchmarks of the
bus.
"""

import json
import subprocess
import sys
import timeit
from collections.abc import Callable
from math import cos, sin
from pathlib import Path
from typing import Any

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.time import Time
from bus_tf2.core import FrameTree, twin
from bus_tf2.messages import message
from bus_tf2.tf2_py import buffer_core
from bus_tf2.tf2_ros import Buffer

_FRAMES, _HZ, _SECONDS = 6, 100, 10
_DEBIAN = "/usr/bin/python3"
_CPP = """
import genpy, json, tf2_py, timeit
from geometry_msgs.msg import TransformStamped
from math import cos, sin
buffer = tf2_py.BufferCore(genpy.Duration(20))
for frame in range({frames}):
    for step in range({steps}):
        t = TransformStamped()
        t.header.frame_id, t.child_frame_id = f"f{{frame}}", f"f{{frame + 1}}"
        t.header.stamp = genpy.Time.from_sec(1 + step / {hz})
        t.transform.translation.x = 1.0
        t.transform.rotation.z, t.transform.rotation.w = sin(step / 20), cos(step / 20)
        buffer.set_transform(t, "x")
times = dict(latest=genpy.Time(0), between=genpy.Time.from_sec(6.005))
looks = dict((name, (lambda time: lambda: buffer.lookup_transform_core("f0", "f6", time))(time))
    for name, time in times.items())
print(json.dumps(dict((name, min(timeit.repeat(look, number=2000, repeat=5)) / 2000 * 1e6)
    for name, look in looks.items())))
"""


def main() -> None:
    rows = {"native": measured(FrameTree), "Python twin": measured(twin.FrameTree)}
    if FrameTree is twin.FrameTree:
        del rows["native"]
        print("there is no native core here", file=sys.stderr)
    if Path(_DEBIAN).exists():
        code = _CPP.format(frames=_FRAMES, steps=_HZ * _SECONDS, hz=_HZ)
        run = subprocess.run([_DEBIAN, "-c", code], capture_output=True, text=True, timeout=120, check=False)
        if run.returncode == 0:
            rows["C++ (tf2 of ROS 1)"] = json.loads(run.stdout)
    print(f"{'us':20}" + "".join(f"{name:>12}" for name in rows["Python twin"]))
    for name, figures in rows.items():
        print(f"{name:20}" + "".join(f"{figure:12.2f}" for figure in figures.values()))


def measured(core: Any) -> dict[str, float]:
    """Microseconds of each call as a program makes it."""
    kept: Any = buffer_core
    kept.FrameTree = core
    buffer = Buffer(Duration(seconds=2 * _SECONDS))
    for frame in range(_FRAMES):
        for step in range(_HZ * _SECONDS):
            buffer.set_transform(transform(frame, step), "x")
    between, latest, last = Time(nanoseconds=6_005_000_000), Time(), transform(0, _HZ * _SECONDS)
    return {
        "latest": best(lambda: buffer.lookup_transform("f0", "f6", latest)),
        "between": best(lambda: buffer.lookup_transform("f0", "f6", between)),
        "can": best(lambda: buffer.can_transform("f0", "f6", between)),
        "set": best(lambda: buffer.set_transform(last, "x")),
    }


def transform(frame: int, step: int) -> Any:
    """The transform from one frame to the next at one time."""
    made = message("geometry_msgs/msg/TransformStamped", child_frame_id=f"f{frame + 1}")
    made.header.frame_id = f"f{frame}"
    made.header.stamp = Time(nanoseconds=10**9 + step * 10**9 // _HZ).to_msg()
    made.transform.translation.x = 1.0
    made.transform.rotation.z, made.transform.rotation.w = sin(step / 20), cos(step / 20)
    return made


def best(call: Callable[[], object], number: int = 2000) -> float:
    return min(timeit.repeat(call, number=number, repeat=5)) / number * 1e6


if __name__ == "__main__":
    main()
