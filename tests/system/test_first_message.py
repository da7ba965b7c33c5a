"""What the first message of a program waits for: imports. Counted, so that no clock is in it."""

import subprocess
import sys
from pathlib import Path

import pytest

import bus

_TALKER = """
import sys
sys.path[:] = {path!r}
import bus
from bus.msg.std_msgs import String

async def main():
    async with bus.Node("talker", arguments=[]) as node:
        publisher = await node.create_publisher(String, "chatter")
        publisher.publish(String(data="hi"))
        print(*sys.modules)

bus.run(main())
"""
_LIBRARIES = """
import sys
sys.path[:] = {path!r}
import asyncio, msgspec
try:
    import uvloop
except ImportError:
    pass
print(*sys.modules)
"""
_LISTENER = _TALKER.replace(
    'create_publisher(String, "chatter")', 'create_subscription(String, "chatter")'
).replace('publisher.publish(String(data="hi"))', "pass")

_UNUSED = {
    "argparse",
    "dataclasses",
    "hashlib",
    "json",
    "pathlib",
    "urllib.parse",
    "yaml",
    *("bus.graph", "bus.idl", "bus.interfaces", "bus.interfacetypes", "bus.logfile", "bus.mistakes"),
    *("bus.client", "bus.service", "bus.envelope", "bus.parameters", "bus.parameterset", "bus.timesource"),
    *("bus.schema", "bus.typediff", "bus.typehash", "bus.spelling", "bus.blocking", "bus.foreground"),
}
"""What neither end needs, and what takes a while to import."""

_RECEIVING = {
    "bus.accounts",
    "bus.dispatcher",
    "bus.inbox",
    "bus.ringinput",
    "bus.sources",
    "bus.subscription",
}


def _modules(program: str) -> set[str]:
    # Without `site`, where an editable installation has put an import hook with imports of its own.
    path = [*sys.path, str(Path(bus.__file__).parents[1])]
    command = [sys.executable, "-I", "-S", "-c", program.format(path=path)]
    return set(subprocess.run(command, check=True, timeout=60, capture_output=True, text=True).stdout.split())


@pytest.mark.usefixtures("daemon")
def test_a_talker_imports_only_what_it_uses() -> None:
    modules = _modules(_TALKER) - _modules(_LIBRARIES)
    assert not modules & (_UNUSED | _RECEIVING)
    assert len({name for name in modules if name.partition(".")[0] == "bus"}) <= 76


@pytest.mark.usefixtures("daemon")
def test_a_listener_imports_only_what_it_uses() -> None:
    modules = _modules(_LISTENER) - _modules(_LIBRARIES)
    assert not modules & _UNUSED
    assert modules >= _RECEIVING


def test_no_collection_of_garbage_runs_while_the_library_is_imported() -> None:
    code = """
import gc, sys
import bus
collections = 0
def count(phase, info):
    global collections
    collections += phase == "start"
gc.callbacks.append(count)
bus.Node
assert (collections, gc.isenabled()) == (0, True), collections
gc.disable()
bus.Rate
assert not gc.isenabled()
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
