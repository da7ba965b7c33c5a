"""Runs a program in Python for a launch, and fills in missing modules of ROS 2, as `bus run` does.

    python -m bus_launch.python_program [--path=FOLDER] PATH [MODULE:FUNCTION] -- ARGUMENTS

`--path`: a folder that its modules are imported from. Errors are the program's own.
"""

import _signal  # type: ignore[import-not-found] # there without loading anything
import sys

# As in bus_cli.entry: while modules load, a Ctrl-C ends it at once.
if __name__ == "__main__" and _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from bus.process.termination import say_nothing_of_signals
from bus_ros import running

__all__ = ["main"]

_PATH = "--path="


def main() -> None:
    at = sys.argv.index("--")
    words, arguments = sys.argv[1:at], sys.argv[at + 1 :]
    folders = [word.removeprefix(_PATH) for word in words if word.startswith(_PATH)]
    path, *target = words[len(folders) :]
    if folders:
        running.add_paths(folders)
    running.fill_in(force=False)
    if target:
        running.run_entry_point(target[0], path, arguments, of_package=False)
    running.run_script(path, arguments)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        say_nothing_of_signals()
        raise
