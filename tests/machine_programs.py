"""Bridges, and others that load zenoh or cyclonedds, as forks of one process that has loaded them.

A start of a bridge costs some milliseconds, not half a second, also on a machine of `netns`.
"""

import atexit
import subprocess
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from typing import IO, Any

from forks import Fork, Forks
from netns import Machine

__all__ = ["begin_on"]

_IMPORTED = (
    *("asyncio", "uvloop", "msgspec", "bus.node", "bus_cli.bridge", "bus_cli.entry", "bus_bridge.program"),
    *("bus_cli.bridge.bridgeargs", "bus_cli.bridge.service", "bus_bridge.config", "bus.link.autostart"),
    *("bus.link.graph_mirror", "bus.link.query", "bus.msg._described", "bus.process.logfile", "bus.runner"),
    *("bus.service.server", "bus_ros.cdr"),
)
_ENGINES = (
    ("zenoh", ("zenoh", "bus_bridge.zenoh.engine")),
    ("xxhash", ("bus_bridge.rmw_zenoh.engine",)),
    ("cyclonedds", ("bus_bridge.dds.cyclone", "bus_bridge.dds.engine", "bus_bridge.dds.node_info")),
)
"""Packages, and what can be imported with each of them."""

_THERE = """
import ctypes, os, runpy, sys
process = os.pidfd_open(int(sys.argv[1]))
folder = os.getcwd()
if ctypes.CDLL(None, use_errno=True).setns(process, 0x40020000):  # CLONE_NEWNET | CLONE_NEWNS
    raise OSError(ctypes.get_errno(), "setns")
os.close(process)
os.chdir(folder)
sys.argv[:] = sys.argv[2:]
sys.path[0] = folder
runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""
"""Runs a module on the machine of a process."""


def _imported() -> tuple[str, ...]:
    found = [name for package, names in _ENGINES if find_spec(package) for name in names]
    return (*_IMPORTED, *found)


_forks = Forks(_imported())
atexit.register(_forks.__exit__, None, None, None)


def begin_on(
    machine: Machine | None, module: str, *arguments: str, output: IO[Any], environment: Mapping[str, str]
) -> subprocess.Popen[bytes] | Fork:
    """Begin `python -m module` on a machine; both of its outputs go to one file."""
    words = ["-m", module, *arguments]
    if _forks.can_run(environment):
        if machine is not None:
            words = ["-c", _THERE, str(machine.pid), module, *arguments]
        number = output.fileno()
        return _forks.run(words, stdout=number, stderr=number, environment=environment)
    prefix = machine.prefix if machine else ()
    return subprocess.Popen(
        [*prefix, sys.executable, *words],
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=output,
        env=dict(environment),
    )
