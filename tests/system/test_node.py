"""Nodes and related things: command-line arguments, timers, callbacks, `bus.run`, the public names."""

import asyncio
import functools
import gc
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import bus
from bus import events
from bus.base.callbacks import is_async, takes_info
from bus.logger import enable_console, set_default_level
from bus.srv.std_srvs import SetBool
from semantics import node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("route")


class Awaited:
    async def __call__(self, message: object) -> None:
        pass

    async def method(self, message: object, info: object) -> None:
        pass


class Called:
    def __call__(self, message: object, info: object) -> None:
        pass


async def with_default(message: object, mine: int = 0) -> None:
    pass


CALLBACKS: list[tuple[Callable[..., Any], bool, bool]] = [
    (print, False, False),
    (lambda message: None, False, False),
    (lambda message, info: None, False, True),
    (with_default, True, False),
    (functools.partial(with_default, mine=1), True, False),
    (Awaited(), True, False),
    (functools.partial(Awaited()), True, False),
    (Awaited().method, True, True),
    (Called(), False, True),
]


@pytest.mark.parametrize(("callback", "awaited", "info"), CALLBACKS)
def test_kinds_of_callbacks(callback: Callable[..., Any], awaited: bool, info: bool) -> None:
    assert (is_async(callback), takes_info(callback)) == (awaited, info)


class TestArguments:
    @pytest.fixture(autouse=True)
    def restored(self) -> Iterator[None]:
        yield
        set_default_level("UNSET")
        enable_console(True)

    def test_a_level_without_a_name_is_for_all(self) -> None:
        bus.Node("node", arguments=["--ros-args", "--log-level", "debug", "--log-level", "quiet:=error"])
        assert bus.get_logger("another").get_effective_level() == bus.Severity.DEBUG
        assert bus.get_logger("quiet").get_effective_level() == bus.Severity.ERROR
        bus.get_logger("quiet").set_level("UNSET")

    def test_no_log_on_stderr(self, capsys: pytest.CaptureFixture[str]) -> None:
        node = bus.Node("node", arguments=["--ros-args", "--disable-stdout-logs"])
        node.get_logger().error("heard?")
        assert "heard?" not in capsys.readouterr().err


class TestTimers:
    async def test_an_object_with_an_async_call(self, node: bus.Node) -> None:
        class Tick:
            ticks = 0

            async def __call__(self) -> None:
                self.ticks += 1

        tick = Tick()
        node.create_timer(0.001, tick)
        await until(lambda: tick.ticks > 2)

    async def test_those_that_nobody_wants_any_more_are_let_go(self, node: bus.Node) -> None:
        calls: list[int] = []
        node.create_timer(0.001, lambda: calls.append(1))  # it runs, so it stays
        kept = node.create_timer(0.001, lambda: calls.append(2))
        kept.cancel()
        for _ in range(9):
            node.create_timer(5.0, calls.clear).cancel()
        gc.collect()
        assert len(node._timers) == 2
        kept.reset()
        await until(lambda: {1, 2} <= set(calls))


def test_run_in_another_thread() -> None:
    results: list[int | None] = []

    async def main() -> int:
        await asyncio.sleep(0)
        return 7

    thread = threading.Thread(target=lambda: results.append(bus.run(main())))
    thread.start()
    thread.join()
    assert results == [7]


def test_a_node_in_another_loop(daemon: object) -> None:
    node = bus.Node("tester", arguments=())

    async def use() -> None:
        for use in (
            lambda: node.create_timer(1.0, print),
            lambda: node.create_client(SetBool, "x").send(None),
        ):
            with pytest.raises(
                bus.ProtocolError, match="node /tester belongs to an event loop that has ended"
            ):
                use()

    bus.run(node.open())
    bus.run(use())
    bus.run(node.close())


def test_the_public_names() -> None:
    assert dir(bus) == sorted(bus.__all__)
    assert set(events.__all__) <= set(bus.__all__)
    assert bus.QoS is bus.qos.QoS
