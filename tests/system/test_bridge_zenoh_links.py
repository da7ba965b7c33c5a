"""Broken zenoh links: two machines with a cable that is unplugged, and bridges that hang or are killed."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh", reason="needs the extra zenoh: make setup installs it")

import netns
from conftest import WAIT_S

_PROGRAM = Path(__file__).parents[1] / "zenoh_side.py"
_LEASE_S = 10.0

pytestmark = pytest.mark.skipif(bool(netns.why_not()), reason=netns.why_not() or "-")


class Program:
    """tests/zenoh_side.py on a machine."""

    def __init__(self, machine: netns.Machine, *words: str) -> None:
        command = [*machine.prefix, sys.executable, str(_PROGRAM), *words]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)

    def tell(self) -> dict[str, Any]:
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write("?\n")
        self.process.stdin.flush()
        told: dict[str, Any] = json.loads(self.process.stdout.readline())
        return told

    def until(self, condition: Callable[[dict[str, Any]], Any], patience_s: float = WAIT_S) -> dict[str, Any]:
        end = time.monotonic() + patience_s
        while not condition(told := self.tell()):
            assert time.monotonic() < end, told
            time.sleep(0.05)
        return told

    def close(self) -> None:
        self.process.send_signal(signal.SIGCONT)
        with self.process:  # closes its input, and waits
            pass

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


class World:
    def __init__(self, machines: netns.Machines, stack: ExitStack, qos: str, size: int, rate_hz: int) -> None:
        self.machines = machines
        self.cable = machines.connect("robot", "laptop")
        self._stack = stack
        self._where = f"tcp/{self.cable.address_of('robot')}:7447"
        self._what = (qos, str(size), str(rate_hz))
        self.robot = self.start_robot()
        self.laptop = self.start_laptop()
        self.laptop.until(lambda told: told["count"] > 20)

    def start_robot(self) -> Program:
        return self._start("robot", "publish", "robot", self._where, *self._what)

    def start_laptop(self) -> Program:
        return self._start("laptop", "read", "laptop", self._where)

    def _start(self, machine: str, *words: str) -> Program:
        program = Program(self.machines[machine], *words)
        self._stack.callback(program.close)
        return program


@contextmanager
def world(qos: str, size: int, rate_hz: int) -> Iterator[World]:
    with netns.Machines("robot", "laptop") as machines, ExitStack() as stack:
        yield World(machines, stack, qos, size, rate_hz)


@pytest.mark.parametrize("qos", ["rk1000v", "rav"], ids=["reliable", "lossless"])
def test_a_cable_that_is_out_for_seconds_loses_nothing(qos: str) -> None:
    with world(qos, 1000, 100) as one:
        with one.cable.pulled():
            time.sleep(2)
        last = one.laptop.tell()["last"]
        one.laptop.until(lambda told: told["last"] > last)
        sent = one.robot.tell()["sent"]
        told = one.laptop.until(lambda told: told["last"] >= sent)
        assert (told["first"], told["missing"], told["repeated"]) == (1, 0, 0)
        assert one.robot.tell()["replaced"] == 0


@pytest.mark.nightly
@pytest.mark.parametrize("how", ["pulled", "down"])
def test_a_cable_that_is_out_for_longer_than_the_lease_comes_back(how: str) -> None:
    with world("rav", 1000, 200) as one:
        with getattr(one.cable, how)():
            one.robot.until(lambda told: not told["buses"], _LEASE_S + WAIT_S)
            one.laptop.until(lambda told: not told["buses"], WAIT_S)
        last = one.laptop.tell()["last"]
        told = one.laptop.until(lambda told: told["last"] > last)
        assert told["repeated"] == 0 and told["buses"] == ["robot"]


@pytest.mark.nightly
@pytest.mark.parametrize("qos", ["rav", "bk1000v"], ids=["lossless", "best effort"])
def test_a_far_side_that_hangs_is_let_go_and_memory_stays(qos: str) -> None:
    with world(qos, 100_000, 0 if qos == "rav" else 500) as one:
        before = one.robot.tell()["memory"]
        os.kill(one.laptop.process.pid, signal.SIGSTOP)
        told = one.robot.until(lambda told: not told["buses"], _LEASE_S + WAIT_S)
        assert told["memory"] - before < 32 << 20
        assert told["slowest_s"] < 0.5
        os.kill(one.laptop.process.pid, signal.SIGCONT)
        last = one.laptop.tell()["last"]
        assert one.laptop.until(lambda told: told["last"] > last + 50)["repeated"] == 0


def test_either_side_is_killed_and_comes_back() -> None:
    with world("rk1000v", 64, 100) as one:
        one.laptop.kill()
        one.robot.until(lambda told: not told["buses"])
        one.laptop = one.start_laptop()
        told = one.laptop.until(lambda told: told["count"] > 20)
        assert (told["missing"], told["repeated"]) == (0, 0)
        one.robot.kill()
        one.laptop.until(lambda told: not told["buses"])
        one.robot = one.start_robot()
        count = one.laptop.tell()["count"]
        one.laptop.until(lambda told: told["count"] > count + 20)


@pytest.mark.nightly
def test_a_slow_link_holds_up_nobody() -> None:
    with world("bk10v", 1_000_000, 30) as one:
        one.machines["robot"].run(
            *("tc", "qdisc", "add", "dev", one.cable.interface_of("robot")),
            *("root", "tbf", "rate", "100mbit", "burst", "64kb", "latency", "50ms"),
        )
        count = one.laptop.tell()["count"]
        began = time.monotonic()
        one.laptop.until(lambda told: told["count"] >= count + 20)
        assert 20 / (time.monotonic() - began) > 4  # 4 messages/s: the link carries 12.5 MB/s
        assert one.robot.tell()["slowest_s"] < 0.5  # the link's queue holds seconds of messages
