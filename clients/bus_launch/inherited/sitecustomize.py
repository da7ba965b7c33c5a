"""Prepares each Python that a launch starts: Python imports this, because PYTHONPATH has its folder.

Fills in missing modules of ROS 2, and makes Python print each line at once. Then it imports the sitecustomize
that Python would have imported without this one.
"""

import sys
from pathlib import Path


def _fill_in() -> None:
    try:
        import bus_ros.import_hook  # noqa: F401
    except ImportError:
        pass  # a Python that busd is not installed in
    if sys.stdout is not None and hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(line_buffering=True)


def _import_next() -> None:
    here = Path(__file__).parent
    before = sys.path[:]
    sys.path[:] = [path for path in before if Path(path) != here]
    ours = sys.modules.pop("sitecustomize", None)
    try:
        __import__("sitecustomize")
    except ImportError:
        if ours is not None:
            sys.modules["sitecustomize"] = ours
    finally:
        sys.path[:] = before


_fill_in()
_import_next()
