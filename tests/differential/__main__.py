"""Runs programs under rclpy and under busd, and prints the differences; see `differential`."""

import argparse
import os
import sys
import tempfile
from pathlib import Path

from cli import Result
from conftest import Daemon
from differential import genuine, page
from differential.compare import PROGRAMS, SHARE, difference, normalized, recording
from packaged import run_bus


def _run_ours(program: Path, folder: Path) -> Result:
    daemon = Daemon(folder / "busd.sock")
    variables = {"BUSD_SOCKET": str(daemon.path), "BUSD_AUTOSTART": "0", "BUS_INTERFACE_PATH": str(SHARE)}
    try:
        return run_bus("run", str(program), **variables)
    finally:
        daemon.stop()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m differential", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="programs (all)")
    parser.add_argument("--record", action="store_true", help="keep what rclpy prints, for tests and docs")
    args = parser.parse_args()
    if reason := genuine.missing():
        print(reason, file=sys.stderr)
        return 1
    os.environ.setdefault("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    for name in args.names or PROGRAMS:
        with tempfile.TemporaryDirectory() as folder:
            theirs = genuine.run(PROGRAMS[name], Path(folder))
            ours = _run_ours(PROGRAMS[name], Path(folder))
        for who, result in (("rclpy", theirs), ("busd", ours)):
            if result.code or result.err:
                print(f"{name}: {who} ends with status {result.code}\n{result.err}", file=sys.stderr)
        lines = difference(normalized(theirs.out), normalized(ours.out))
        if args.record:
            recording(name).write_text("".join(f"{line}\n" for line in normalized(theirs.out)))
            page.write({name: lines})
        print(f"{name}: {'differs' if lines else 'same'}", *lines, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
