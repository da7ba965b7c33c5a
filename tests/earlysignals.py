"""Programs that get a signal at a random moment of their start, and how each one ends.

A program must end by the signal, silently. The moments begin after the start of the interpreter: before that,
Python prints a traceback or loses a Ctrl-C by itself. Two more ends are Python's own and counted separately:

- a traceback from before our first line
- a Ctrl-C lost while Python looks for the program's file, or in the last step of the program's own `import`
  statement
"""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Final

import bus
import busd
from conftest import WAIT_S
from programs import EXAMPLES

CONNECT: Final = """\
import bus
from bus.msg.std_msgs import String
with bus.connect("early") as node:
    for message in node.listen(String, "topic"):
        pass
"""
RCLPY: Final = """\
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

class Publisher(Node):
    def __init__(self):
        super().__init__("early")
        self.publisher = self.create_publisher(String, "topic", 10)
        self.timer = self.create_timer(0.1, lambda: self.publisher.publish(String(data="hi")))

rclpy.init()
rclpy.spin(Publisher())
"""

MOMENTS_S: Final = 1.5
"""The signal comes within this time; later if the machine is slow."""

LOST_BY_PYTHON: Final = "lost by Python"

_TOGETHER: Final = 3
_FOLDERS: Final = [
    re.escape(str(Path(package.__file__ or "").parents[level])) for package, level in ((bus, 1), (busd, 0))
]
_OURS: Final = re.compile(rf'File "(?:{"|".join(_FOLDERS)})/[^"]*(?<!/__main__\.py)"').search
"""A line of a traceback in one of our files; `__main__.py` stands for the program itself."""

_FAULTS: Final = ("Traceback", "Fatal Python error", "never awaited", "Exception ignored")
_LOST: Final = (
    "Exception ignored in: <function _get_module_lock.<locals>.cb",
    "Failed checking if argv[0] is an import path entry",
)
_READY: Final = "BUSD_EARLY_READY"
_SITE: Final = f"""\
import os
number = int(os.environ["{_READY}"])
os.write(number, b".")
os.close(number)
"""


@dataclass
class Findings:
    """Counts of each program's ends, and the bad ends with their moments."""

    ends: Counter[str] = field(default_factory=Counter)
    bad: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return ", ".join(f"{count} {end}" for end, count in sorted(self.ends.items()))


def programs(folder: Path) -> dict[str, Callable[[int], Sequence[str]]]:
    """The command for the start with a given number, for each program. All except busd need a busd."""
    connect, ros = folder / "connect.py", folder / "ros.py"
    connect.write_text(CONNECT)
    ros.write_text(RCLPY)
    python, bus_cli = (sys.executable,), (sys.executable, "-m", "bus_cli")
    return {
        "talker.py": lambda _: (*python, str(EXAMPLES / "talker.py")),
        "listener.py": lambda _: (*python, str(EXAMPLES / "listener.py")),
        "bus.connect": lambda _: (*python, str(connect)),
        "bus run": lambda _: (*bus_cli, "run", str(ros)),
        "bus topic echo": lambda _: (*bus_cli, "topic", "echo", "/topic", "std_msgs/msg/String"),
        "busd": lambda number: (*python, "-m", "busd", "--socket", str(folder / f"{number}.sock")),
    }


def try_out(
    command: Callable[[int], Sequence[str]], starts: int, number: signal.Signals, random: Random, folder: Path
) -> Findings:
    """Start a program `starts` times, each time with the signal at a random moment.

    `folder` is for a file that Python runs at the end of the interpreter's start.
    """
    site = folder / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(_SITE)
    found = Findings()
    span_s = max(MOMENTS_S, 3 * _start_s())
    tasks = iter([(start, random.uniform(0, span_s)) for start in range(starts)])
    lock = threading.Lock()

    def work() -> None:
        while True:
            with lock:
                task = next(tasks, None)
            if task is None:
                return
            start, moment_s = task
            end, said = _one(command(start), number, moment_s, site)
            with lock:
                found.ends[end] += 1
                if end.startswith("BAD"):
                    found.bad.append(f"at {moment_s:.3f} s: {end}\n{said}")

    threads = [threading.Thread(target=work) for _ in range(_TOGETHER)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def _start_s() -> float:
    """The present duration of a short program of the bus, from start to end."""
    begin = time.monotonic()
    subprocess.run((sys.executable, "-m", "bus_cli", "topic", "list"), stdout=subprocess.DEVNULL, check=True)
    return time.monotonic() - begin


def _one(command: Sequence[str], number: signal.Signals, moment_s: float, site: Path) -> tuple[str, str]:
    """The end of one start, and its output on stderr. The moment counts from the interpreter's start."""
    ready, signals_ready = os.pipe()
    variables = {"PYTHONPATH": str(site), "PYTHONFAULTHANDLER": "1", _READY: str(signals_ready)}
    process = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **variables},
        pass_fds=[signals_ready],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # also in background
    )
    os.close(signals_ready)
    assert os.read(ready, 1) == b"."
    os.close(ready)
    time.sleep(moment_s)  # the moment itself, not a wait for an event
    process.send_signal(number)
    try:
        _, said = process.communicate(timeout=WAIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        _, said = process.communicate()
        return (LOST_BY_PYTHON if any(sign in said for sign in _LOST) else "BAD: runs on"), said
    return judge(process.returncode, said, number, in_order=_in_order(command, number)), said


def _in_order(command: Sequence[str], number: signal.Signals) -> str | None:
    """The text with which a program may end with status 0; None: it may not."""
    if "busd" in command:
        return f"stopped: {number.name}"
    # SIGTERM shuts rclpy down; a `spin` that begins after that returns, as in ROS 2.
    return "" if "run" in command and number == signal.SIGTERM else None


def judge(code: int, said: str, number: signal.Signals, *, in_order: str | None = None) -> str:
    """The end of a start in a word; it begins with BAD if users must not see such an end."""
    if any(sign in said for sign in _FAULTS) or code == 1:
        is_pythons = "KeyboardInterrupt" in said and code in (1, -number) and not _OURS(said)
        return "before our first line" if is_pythons else f"BAD: {code}"
    if code == 0 and in_order is not None and in_order in said:
        return "in order"
    return f"by {number.name}" if code == -number else f"BAD: {code}"
