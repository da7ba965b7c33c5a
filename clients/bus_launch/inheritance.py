"""The environment of a launch's processes: busd's modules if ROS 2's are missing, and a `ros2`.

Owns: the environment that is set for them. Must not know: actions, and which `launch` runs.
"""

import os
import shutil
import sys
from pathlib import Path
from typing import Final

from bus_launch.launch_ros.programs import with_sourced_workspace

__all__ = ["prepare"]

_FOLDER: Final = str(Path(__file__).with_name("inherited"))


def prepare() -> None:
    """Set the environment of this process, which a launch's children inherit.

    PYTHONPATH gets a sitecustomize that fills in ROS 2's modules; PATH the folder of this Python and, without
    a `ros2`, a `ros2` that is `bus`; a workspace around the current folder counts as sourced.
    """
    with_sourced_workspace()
    _add("PYTHONPATH", _FOLDER, at_end=False)
    _add("PATH", os.path.dirname(sys.executable), at_end=False)  # noqa: PTH120 (a link stays a link)
    if shutil.which("ros2") is None:
        os.environ["BUS_LAUNCH_PYTHON"] = sys.executable
        _add("PATH", _FOLDER, at_end=True)


def _add(name: str, folder: str, *, at_end: bool) -> None:
    parts = [part for part in os.environ.get(name, "").split(os.pathsep) if part]
    if folder not in parts:
        os.environ[name] = os.pathsep.join([*parts, folder] if at_end else [folder, *parts])
