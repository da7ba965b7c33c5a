"""The program `launch_test`: `python -m launch_testing.launch_test FILE [name:=value]`, and `bus test`."""

import os
import sys
from argparse import ArgumentParser
from collections.abc import Sequence

from bus_launch.launch.errors import describe
from bus_launch.launch_testing.runner import run_file

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> int:
    """Returns 0 if all tests passed, else 1."""
    parser = ArgumentParser(prog="launch_test", description="Run a test file of launch_testing.")
    parser.add_argument("-v", "--verbose", action="store_true", help="the name of each test")
    parser.add_argument("test_file", help="a file with generate_test_description()")
    parser.add_argument("arguments", nargs="*", metavar="name:=value", help="arguments of the launch")
    args = parser.parse_args(words)
    path = os.path.abspath(args.test_file)  # noqa: PTH100 (links stay)
    pairs = [word.partition(":=") for word in args.arguments]
    try:
        given = {name: value for name, _, value in pairs}
        return 0 if run_file(path, given, verbosity=2 if args.verbose else 1) else 1
    except Exception as error:
        print(f"launch_test: {args.test_file}: {type(error).__name__}: {describe(error)}", file=sys.stderr)
        if isinstance(error, ModuleNotFoundError) and error.name == "pytest":
            print("the file needs pytest: pip install pytest", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
