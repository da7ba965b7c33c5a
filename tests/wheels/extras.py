"""The extras of a wheel: each one alone, in an environment of its own, by a program that needs it."""

import os
import pty
import re
import select
import signal
import subprocess
import time
from collections.abc import Iterable
from typing import NamedTuple

from packaging.requirements import Requirement

from bus.base.optional import how_to_install
from ports import free_port, own_domain
from wheels import Wrong
from wheels.first_use import PATIENCE_S, Environment

__all__ = ["FOR_DEVELOPERS", "TRIALS", "Trial", "applies", "check_refusal", "try_extra"]

FOR_DEVELOPERS = {"bench", "dev", "docs", "fuzz", "release", "soak"}

_VISION = """\
from cv_bridge import CvBridge
from sensor_msgs.msg import Image

raw = Image(height=4, width=6, step=6, encoding="bayer_rggb8", data=bytes(24))
print("an image of", CvBridge().imgmsg_to_cv2(raw, "bgr8").shape)
"""


class Trial(NamedTuple):
    """A program that needs an extra."""

    words: tuple[str, ...]
    """Arguments of `bus`. {port} and {domain} stand for a free port and an unused domain of DDS."""
    shows: str
    """Pattern of the text that it shows on its terminal if the extra is installed."""
    distribution: str
    """The packages that it names as missing otherwise, with blanks in between."""
    key: str = ""
    """The key that ends it; by default Ctrl-C does, unless it ends by itself."""
    files: tuple[tuple[str, str], ...] = ()
    """Names and contents of files in its folder."""


TRIALS = {
    "bag": Trial(("bag", "record", "--all", "--output", "bag"), r"Recording\.\.\.", "mcap"),
    "cli": Trial(("completion", "bash"), r"complete .*-F", "argcomplete"),
    "metrics": Trial(("metrics", "--once"), r"# TYPE busd_", "prometheus-client"),
    "ros2": Trial(
        ("bridge", "ros2", "--domain-id", "{domain}", "--carrier", "cyclonedds"),
        r"in ROS 2's domain \d+ on DDS",
        "cyclonedds",
    ),
    "rmw-zenoh": Trial(
        ("bridge", "ros2", "--rmw", "zenoh", "--listen", "tcp/127.0.0.1:{port}", "--domain-id", "3"),
        r"listening on tcp/127\.0\.0\.1:\d+",
        "eclipse-zenoh xxhash",
    ),
    "top": Trial(("top",), r"TOPIC", "textual", key="q"),
    "vision": Trial(
        ("run", "vision.py"),
        r"an image of \(4, 6, 3\)",
        "numpy",
        files=(("vision.py", _VISION),),
    ),
    "web": Trial(("web", "--listen", "127.0.0.1:0"), r"page: http://127\.0\.0\.1:", "websockets"),
    "zenoh": Trial(
        ("bridge", "zenoh", "--listen", "tcp/127.0.0.1:{port}"),
        r"listening on tcp/127\.0\.0\.1:\d+",
        "eclipse-zenoh",
    ),
}
"""By the name of the extra."""


def applies(requirements: Iterable[str], version: tuple[int, ...]) -> bool:
    """Whether any package of an extra is for this machine and this version of Python."""
    python = {"python_version": ".".join(map(str, version[:2]))}
    return any(not one.marker or one.marker.evaluate(python) for one in map(Requirement, requirements))


def try_extra(environment: Environment, trial: Trial) -> None:
    """Run the trial where the extra is installed. Raises Wrong."""
    environment.run("bus", "daemon", "start")
    text, status = _show(environment, trial, trial.shows)
    if not re.search(trial.shows, text) or status not in (0, -signal.SIGINT, 128 + signal.SIGINT):
        raise Wrong(f"bus {' '.join(trial.words)} ended with {status}, wanted {trial.shows!r}:\n{text}")
    environment.run("bus", "daemon", "stop")


def check_refusal(environment: Environment, trial: Trial) -> None:
    """Run the trial without the extra: it must fail and name what is missing. Raises Wrong."""
    environment.run("bus", "daemon", "start")
    wanted = how_to_install(*trial.distribution.split())
    text, status = _show(environment, trial, re.escape(wanted))
    if not status or wanted not in text:
        raise Wrong(f"without its extra, bus {' '.join(trial.words)} ended with {status}:\n{text}")
    environment.run("bus", "daemon", "stop")


def _show(environment: Environment, trial: Trial, pattern: str) -> tuple[str, int]:
    """Run it on a terminal until that shows the pattern, then end it; its text and its exit status."""
    for name, content in trial.files:
        (environment.folder / name).write_text(content)
    words = [word.format(port=free_port(), domain=own_domain()) for word in trial.words]
    ours, its = pty.openpty()
    with subprocess.Popen(
        [environment.bin / "bus", *words],
        cwd=environment.folder,
        env={**environment.variables, "TERM": "xterm", "COLUMNS": "200"},
        stdin=its,
        stdout=its,
        stderr=its,
        start_new_session=True,
    ) as program:
        os.close(its)
        try:
            text = _read(ours, pattern)
            if program.poll() is None:
                os.write(ours, trial.key.encode()) if trial.key else program.send_signal(signal.SIGINT)
            text += _read(ours, "")
            program.wait(PATIENCE_S)
        finally:
            program.kill()
            os.close(ours)
    return text, program.returncode


def _read(terminal: int, pattern: str) -> str:
    """The text up to the pattern; without one, up to the program's end. What came in a minute, if neither."""
    end, text = time.monotonic() + PATIENCE_S, ""
    while not (pattern and re.search(pattern, text)):
        left = end - time.monotonic()
        if left <= 0 or not select.select([terminal], [], [], left)[0]:
            break
        try:
            text += os.read(terminal, 1 << 16).decode(errors="replace")
        except OSError:  # the program's end, on Linux
            break
    return text
