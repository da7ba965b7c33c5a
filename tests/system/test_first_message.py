"""The costs before a program's first message: imports, and answers of busd. The tests use no clock."""

import asyncio
import logging
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

import bus
import bus.node.rosout
from bus.msg.rcl_interfaces import Log
from bus.msg.std_msgs import String
from bus.wire import messages as m
from conftest import WAIT_S
from fake_broker import FakeBroker, FakeConnection
from rows import for_each

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
_RCLPY_TALKER = """
import sys
sys.path[:] = {path!r}
import bus.rclpy_compat, rclpy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("talker")
publisher = node.create_publisher(String, "chatter", 10)
node.create_timer(0.001, lambda: publisher.publish(String(data="hi")))
rclpy.spin_once(node)
print(*sys.modules)
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
    "bus.graph",
    "bus.schema",
    "bus.link.autostart",
    "bus.types.idl",
    "bus.types.definitions",
    "bus.types.classes",
    "bus.process.logfile",
    "bus.process.mistakes",
    "bus.service.base",
    "bus.service.client",
    "bus.service.server",
    "bus.types.service",
    "bus.loan",
    "bus.parameters.values",
    "bus.parameters.store",
    "bus.parameters.parameter_set",
    "bus.parameters.time_source",
    "bus.types.schema",
    "bus.types.diff",
    "bus.types.hash",
    "bus.base.suggest",
    "bus.blocking",
    "bus.process.foreground",
    "bus.process.shared_loop",
}
"""Modules that neither end needs, and that take a while to import."""

_RECEIVING = {
    "bus.delivery.counters",
    "bus.delivery.dispatcher",
    "bus.delivery.receiver",
    "bus.delivery.shm_receiver",
    "bus.delivery.sequence",
    "bus.subscription",
}


def _modules(program: str) -> set[str]:
    # Without `site`: there an editable installation has an import hook with further imports.
    path = [*sys.path, str(Path(bus.__file__).parents[1])]
    command = [sys.executable, "-I", "-S", "-c", program.format(path=path)]
    return set(subprocess.run(command, check=True, timeout=60, capture_output=True, text=True).stdout.split())


@pytest.mark.usefixtures("daemon")
def test_a_talker_imports_only_what_it_uses() -> None:
    modules = _modules(_TALKER) - _modules(_LIBRARIES)
    assert not modules & (_UNUSED | _RECEIVING)
    assert len({name for name in modules if name.partition(".")[0] == "bus"}) <= 99  # a tenth are folders


@pytest.mark.usefixtures("daemon")
@for_each("program", [_TALKER, _LISTENER])
def test_modules_of_python_that_few_programs_use_are_not_loaded(program: str) -> None:
    modules = _modules(program)
    assert modules >= {"ssl", "inspect", "tokenize"}  # lazy
    assert not modules & {
        "argparse",
        "ast",
        "base64",
        "dataclasses",
        "dis",
        "json",
        "pathlib",
        "token",
        "yaml",
    }


@pytest.mark.usefixtures("daemon")
def test_a_listener_imports_only_what_it_uses() -> None:
    modules = _modules(_LISTENER) - _modules(_LIBRARIES)
    assert not modules & _UNUSED
    assert modules >= _RECEIVING


def test_a_verb_of_bus_loads_none_of_them_either() -> None:
    modules = _modules(
        "import sys; sys.path[:] = {path!r}; from bus_cli.main import make_parser; "
        "make_parser(['topic', 'echo', '/topic']); print(*sys.modules)"
    )
    assert modules >= {"asyncio", "bus.subscription", "ssl", "inspect"}  # the last two are lazy
    assert not modules & {"_ssl", "ast", "base64", "dis", "yaml"}


@pytest.mark.usefixtures("daemon")
def test_a_talker_of_rclpy_imports_only_what_it_uses() -> None:
    modules = _modules(_RCLPY_TALKER)
    # The last three are lazy: they load at the first access to a name in them.
    assert modules >= {"bus_ros.rclpy.node", "ssl", "inspect", "asyncio.sslproto"}
    assert not modules & {"_ssl", "ast", "argparse", "dataclasses", "hashlib", "json", "pathlib", "yaml"}
    assert not modules & {
        "bus.base.suggest",
        "bus.types.diff",
        "bus_ros.rosidl.runtime",
        "bus_ros.rclpy.action",
    }


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
young, threshold = gc.get_count()[0], gc.get_threshold()[0]
assert young < threshold, young  # nor has it been put off
gc.freeze()
frozen = gc.get_freeze_count()
bus.Subscription
assert gc.get_freeze_count() >= frozen - 100 and gc.isenabled()
gc.unfreeze()
gc.disable()
bus.Rate
assert not gc.isenabled()
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.fixture
async def broker(socket_path: Path) -> AsyncIterator[FakeBroker]:
    async with asyncio.timeout(WAIT_S), FakeBroker(socket_path) as broker:
        yield broker


async def _opened(broker: FakeBroker) -> tuple[bus.Node, FakeConnection, m.CreatePublisher]:
    """A node that still waits for busd's answer about /rosout."""
    node = bus.Node("node", arguments=[])
    opening = asyncio.ensure_future(node.open())
    client = await broker.accept()
    await client.create(m.CreateNode, 1)
    await opening
    rosout = await client.expect(m.CreatePublisher)
    assert (rosout.node, rosout.topic) == (1, "/rosout")
    return node, client, rosout


async def test_nobody_waits_for_the_topic_of_the_log(broker: FakeBroker) -> None:
    node, client, rosout = await _opened(broker)
    making = asyncio.ensure_future(node.create_publisher(String, "chatter"))
    chatter = await client.expect(m.CreatePublisher)  # so three requests are pending at most, with Hello
    client.send(m.Created(request=chatter.request, id=3, depth=10, max_message_bytes=1 << 20))
    assert (await making)._core.id == 3
    client.send(m.Created(request=rosout.request, id=2, depth=1000, max_message_bytes=1 << 20))
    await node.close()


async def test_a_refused_log_stays_here(broker: FakeBroker, caplog: pytest.LogCaptureFixture) -> None:
    node, client, rosout = await _opened(broker)
    logging.getLogger("bus.nodes").addHandler(caplog.handler)
    node.get_logger().info("before")
    client.send(m.Refused(request=rosout.request, text="too many", resource="endpoints", used=1, limit=1))
    await node._rosout._declaring
    node.get_logger().info("after")
    logging.getLogger("bus.nodes").removeHandler(caplog.handler)
    texts = [record.getMessage() for record in caplog.records]
    assert texts[0] == "before" and "the log of this node stays here: endpoints: 1 of 1" in texts[1]
    assert texts[2:] == ["after"]
    assert node.statistics().publishers == 0
    await node.close()


async def test_a_node_ends_though_busd_never_answers(
    broker: FakeBroker, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bus.node.rosout, "_END_S", 0.01)
    node, client, _ = await _opened(broker)
    node.get_logger().info("for nobody")
    await node.close()
    await client.expect(m.DestroyNode)
    assert await client.receive() is None


async def test_an_end_that_is_cancelled_leaves_nothing_behind(broker: FakeBroker) -> None:
    node, client, _ = await _opened(broker)
    ending = asyncio.ensure_future(node.close())
    await asyncio.sleep(0)
    ending.cancel()
    with pytest.raises(asyncio.CancelledError):
        await ending
    await client.expect(m.DestroyNode)
    assert await client.receive() is None


@pytest.mark.usefixtures("daemon")
async def test_what_is_logged_before_busd_has_answered_is_told_in_order() -> None:
    async with asyncio.timeout(WAIT_S), bus.Node("listener", arguments=[], rosout=False) as listener:
        heard = await listener.create_subscription(Log, "/rosout", 100)
        for name in ("stays", "goes"):
            node = bus.Node(name, arguments=[])
            await node.open()
            for number in range(3):
                node.get_logger().info(f"{number}")
            if name == "goes":
                await node.close()
            assert [(await heard.receive())[0].msg for _ in range(3)] == ["0", "1", "2"]
            await node.close()
