"""ROS 2's own rclpy: runs a program in isolation from the machine's ROS."""

import json
import os
import subprocess
from functools import cache
from pathlib import Path

from benchmarks import ros
from cli import Result
from conftest import WAIT_S

# Fast DDS's shared memory would find processes of another network.
_ALONE = (
    *("unshare", "--net", "--mount", "sh", "-c"),
    "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && mount -t tmpfs none /dev/shm"
    ' && exec "$0" "$@"',
)


def missing() -> str:
    """The reason why there is no rclpy; empty if there is one."""
    if reason := ros.missing():
        return reason
    site = ros.PYTHON.parents[1].glob("lib/python*/site-packages/test_msgs")
    return "" if any(site) else "test_msgs is not installed beside it: make peers"


def run(program: Path, folder: Path) -> Result:
    """Run a program to its end; `folder` is for its files."""
    alone = _ALONE if _can_be_alone() else ()
    done = subprocess.run(
        [*alone, str(ros.PYTHON), str(program)],
        capture_output=True,
        text=True,
        timeout=2 * WAIT_S,
        env={**os.environ, **ros.environ(folder)},
        check=False,
    )
    return Result(done.stdout, done.stderr, done.returncode)


def hashes() -> dict[str, str]:
    """The hash of each type that is installed there, by its name."""
    found = {}
    for path in (ros.PYTHON.parents[1] / "share").glob("*/*/*.json"):
        for one in json.loads(path.read_text()).get("type_hashes", ()):
            found[one["type_name"]] = one["hash_string"]
    return found


@cache
def _can_be_alone() -> bool:
    """Whether isolation is possible; otherwise the program has a separate domain."""
    try:
        return subprocess.run([*_ALONE, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        return False
