"""Log lines and errors of docs/faq.md: a program makes the mistakes, and prints them."""

import asyncio
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bus
from bus import shm
from conftest import TEST_S, WAIT_S, Daemon
from pages import ROOT, blocks, shape

SHOWN = [
    line for block in blocks("log", (ROOT / "docs" / "faq.md").read_text()) for line in block.splitlines()
]
NO_CORE = "the native core was not built"
OF_BUSD = ("lost busd (", "busd is back (")

MISTAKES = """
import asyncio
import os
import sys
import time
import traceback
from typing import ClassVar

import msgspec

import bus
from bus.msg.std_msgs import Int32, String
from bus.srv.example_interfaces import AddTwoInts


class Ours(msgspec.Struct):
    __type_name__: ClassVar[str] = "demo/msg/Wheel"
    speed: float = 0.0


class Theirs(msgspec.Struct):
    __type_name__: ClassVar[str] = "demo/msg/Wheel"
    speed: str = ""


def slow(message: Int32) -> None:
    time.sleep(0.21)
    done.set()


def say(error: bus.BusError) -> None:
    print(*traceback.format_exception_only(error), sep="", end="", file=sys.stderr, flush=True)


async def main() -> None:
    async with bus.Node("driver", arguments=[]) as driver, bus.Node("listener", arguments=[]) as listener:
        await driver.create_publisher(String, "scan", "sensor_data")
        await listener.create_subscription(String, "scan", 10)
        await driver.create_publisher(Ours, "wheel", 10)
        await listener.create_subscription(Theirs, "wheel", 10)

        numbers = await driver.create_publisher(Int32, "numbers", 10)
        await listener.create_subscription(Int32, "numbers", 10)
        for number in range(1500):
            numbers.publish(Int32(data=number))

        await listener.create_subscription(Int32, "slow", 10, slow)
        (await driver.create_publisher(Int32, "slow", 10)).publish(Int32())
        await done.wait()

        driver.create_publisher(String, "forgotten", 10)
        client = await driver.create_client(AddTwoInts, "add")
        try:
            await client.call(AddTwoInts.Request())
        except bus.ServiceUnavailable as error:
            say(error)
        if child := os.fork():
            os.waitpid(child, 0)
        else:
            try:
                numbers.publish(Int32())
            except bus.ForkError as error:
                say(error)
            os._exit(0)
        async with bus.Node("driver", arguments=[]) as twin:
            await twin.create_publisher(String, "other", 10)


done = asyncio.Event()
bus.run(main())
with bus.connect("script") as node:
    node.publish("nowhere", String(data="hello?"))
"""
WITHOUT_CORE = """
import sys


class Finder:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == "bus.shm._core":
            raise ModuleNotFoundError(f"No module named {name!r}")


sys.meta_path.insert(0, Finder)
import bus

bus.connect("n").close()
"""

pytestmark = pytest.mark.usefixtures("daemon")


def _printed(folder: Path, program: str) -> list[str]:
    (folder / "mistakes.py").write_text(program)
    done = subprocess.run(
        [sys.executable, "mistakes.py"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=TEST_S,
        check=True,
    )
    return done.stderr.replace(f"{folder}/", "").splitlines()


@pytest.mark.parametrize("route", ["shm"], indirect=True)
def test_mistakes(route: str, tmp_path: Path) -> None:
    printed = _printed(tmp_path, MISTAKES)
    for line in SHOWN:
        if NO_CORE not in line and not any(text in line for text in OF_BUSD):
            assert any(re.fullmatch(shape(line), one) for one in printed), (line, printed)


@pytest.mark.skipif(not shm.has_core(), reason="elsewhere the reason differs")
def test_without_the_native_core(tmp_path: Path) -> None:
    (shown,) = [line for line in SHOWN if NO_CORE in line]
    assert [one for one in _printed(tmp_path, WITHOUT_CORE) if re.fullmatch(shape(shown), one)]


async def test_a_busd_that_ends(daemon: Daemon, capfd: pytest.CaptureFixture[str]) -> None:
    shown = [line for line in SHOWN if any(text in line for text in OF_BUSD)]
    async with asyncio.timeout(WAIT_S), bus.Node("n", arguments=[]) as node:
        daemon.stop()
        daemon.restart()
        await node.graph()
    printed = capfd.readouterr().err.splitlines()
    assert len(shown) == len(OF_BUSD)
    for line in shown:
        assert any(re.fullmatch(shape(line), one) for one in printed), (line, printed)
