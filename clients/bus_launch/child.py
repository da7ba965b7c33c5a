"""`python -m bus_launch.child [--path=FOLDER] PATH [MODULE:FUNCTION] -- ARGUMENTS`: a node in Python.

How a launch starts it. `--path`: a folder that its modules are imported from.

With ROS 2's modules filled in where they are missing, as `bus run` has it; errors are the program's own.
"""

import sys

from bus.process.termination import say_nothing_of_signals
from bus_ros import launching

__all__ = ["main"]

_PATH = "--path="


def main() -> None:
    at = sys.argv.index("--")
    words, arguments = sys.argv[1:at], sys.argv[at + 1 :]
    folders = [word.removeprefix(_PATH) for word in words if word.startswith(_PATH)]
    path, *target = words[len(folders) :]
    if folders:
        launching.add_paths(folders)
    launching.fill_in(force=False)
    if target:
        launching.run_entry_point(target[0], path, arguments, of_package=False)
    launching.run_script(path, arguments)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        say_nothing_of_signals()
        raise
