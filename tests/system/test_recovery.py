"""Processes that die, hang and return: the graph stays correct, and the living continue."""

import asyncio
import logging
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest

import bus
from bus.msg.std_msgs import Int32
from conftest import WAIT_S, Daemon
from neighbours import with_limits
from semantics import LATCHED, until

pytestmark = pytest.mark.usefixtures("route")

LEASE_S = 2.0
"""Longer than a busy machine may delay a process that is not stopped."""

TALKER = """
import asyncio, sys
import bus
from bus.msg.std_msgs import Int32

async def main():
    async with bus.Node(sys.argv[1], arguments=[], rosout=False) as node:
        qos = bus.QoSProfile(10, liveliness_lease_duration=1.0)
        publisher = await node.create_publisher(Int32, "count", qos)
        number = 0
        while True:
            publisher.publish(Int32(data=number))
            number += 1
            await asyncio.sleep(0.01)

bus.run(main())
"""


@pytest.fixture
def program(daemon: Daemon) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts a Python program that must print only log lines on stderr."""
    programs: list[subprocess.Popen[str]] = []

    def start(source: str, *arguments: str) -> subprocess.Popen[str]:
        programs.append(
            subprocess.Popen(
                [sys.executable, "-c", source, *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return programs[-1]

    yield start
    for one in programs:
        one.send_signal(signal.SIGCONT)
        one.terminate()
        _, errors = one.communicate(timeout=WAIT_S)
        assert "Traceback" not in errors, errors


@pytest.fixture
async def node(daemon: Daemon) -> AsyncIterator[bus.Node]:
    async with asyncio.timeout(WAIT_S), bus.Node("watcher", arguments=[], rosout=False) as node:
        yield node


async def nodes(node: bus.Node) -> set[str]:
    return {one.name for one in (await node.graph()).nodes}


async def until_nodes(node: bus.Node, *names: str) -> None:
    while await nodes(node) != {"watcher", *names}:  # noqa: ASYNC110
        await asyncio.sleep(0.002)


async def until_said(program: subprocess.Popen[str], text: str) -> str:
    """The program's stderr, once it contains `text`."""
    assert program.stderr is not None
    descriptor, said = program.stderr.fileno(), ""
    os.set_blocking(descriptor, False)
    while text not in said:
        try:
            more = os.read(descriptor, 1 << 16)
            assert more, f"ended without {text!r}: {said}"
            said += more.decode()
        except BlockingIOError:
            await asyncio.sleep(0.002)
    os.set_blocking(descriptor, True)
    return said


async def until_restarted(daemon: Daemon, *endpoints: bus.Publisher[Int32] | bus.Subscription[Int32]) -> None:
    """Kills busd, starts another one, and waits until it knows the endpoints."""
    daemon.kill()
    await until(lambda: not any(one._core.id for one in endpoints))
    daemon.restart()
    await until(lambda: all(one._core.id for one in endpoints))


class TestClients:
    async def test_a_killed_one_is_gone(
        self, node: bus.Node, program: Callable[..., subprocess.Popen[str]]
    ) -> None:
        subscription = await node.create_subscription(Int32, "count", 1000)
        talker = program(TALKER, "talker")
        await subscription.receive()
        assert await nodes(node) == {"watcher", "talker"}
        talker.kill()
        await until_nodes(node)
        assert subscription.get_publisher_count() == 0
        assert (await node.graph()).publishers == ()

    @with_limits(lease_s=LEASE_S)
    async def test_a_stopped_one_keeps_its_place(
        self, daemon: Daemon, node: bus.Node, program: Callable[..., subprocess.Popen[str]]
    ) -> None:
        """busd and the program report its silence. A subscription with a lease gets an event, too."""
        alive: list[int] = []
        subscription = await node.create_subscription(
            Int32,
            "count",
            bus.QoSProfile(1000, liveliness_lease_duration=LEASE_S / 2),
            events=bus.SubscriptionEvents(liveliness_changed=lambda change: alive.append(change.alive_count)),
        )
        talker = program(TALKER, "talker")
        await subscription.receive()
        talker.send_signal(signal.SIGSTOP)
        await until(lambda: f"no sign of life from -c (pid {talker.pid}) for " in daemon.log.read_text())
        assert alive[-1] == 0
        assert await nodes(node) == {"watcher", "talker"}
        assert subscription.get_publisher_count() == 1
        while subscription.take():
            pass
        # It counts from its last heartbeat, or from the moment busd set the interval: a beat later at most.
        await asyncio.sleep(LEASE_S / 4)
        talker.send_signal(signal.SIGCONT)
        await subscription.receive()
        log = await until_said(talker, "this program's event loop stood still for ")
        await until(lambda: f"-c (pid {talker.pid}) is heard again, after " in daemon.log.read_text())
        await until(lambda: alive[-1] == 1)
        talker.terminate()
        log += talker.communicate(timeout=WAIT_S)[1]
        assert log.count("stood still") == 1
        assert "lost busd" not in log

    @with_limits(lease_s=3600)
    async def test_a_child_does_not_keep_its_dead_parent_alive(
        self, node: bus.Node, program: Callable[..., subprocess.Popen[str]]
    ) -> None:
        """A forked worker has the parent's socket too."""
        source = TALKER.replace(
            "number = 0",
            """
        import os, time
        if not os.fork():
            sys.stdin.read()
            os._exit(0)
        number = 0
""".strip(),
        )
        talker = program(source, "talker")
        await until_nodes(node, "talker")
        talker.kill()
        await until_nodes(node)


class TestBroker:
    async def test_messages_flow_again(
        self, daemon: Daemon, node: bus.Node, caplog: pytest.LogCaptureFixture
    ) -> None:
        caplog.set_level(logging.INFO, "bus")
        heard: list[int] = []
        subscription = await node.create_subscription(
            Int32, "t", 10, lambda message: heard.append(message.data)
        )
        publisher = await node.create_publisher(Int32, "t", 10)
        for restart in range(3):
            publisher.publish(Int32(data=restart))
            await until(lambda restart=restart: len(heard) > restart)  # type: ignore[misc]
            await until_restarted(daemon, publisher, subscription)
        assert heard == [0, 1, 2]
        assert (await node.graph()).broker_pid == daemon.pid
        assert subscription.statistics().dropped == {}
        said = [record.getMessage() for record in caplog.records if record.name == "bus"]
        said = [line for line in said if not line.startswith("busd is not back yet")]  # it may take a while
        assert len([line for line in said if line.startswith("lost busd")]) == 3
        assert len([line for line in said if line.startswith("busd is back")]) == 3
        assert len(said) == 6

    async def test_what_is_published_meanwhile(self, daemon: Daemon, node: bus.Node, route: str) -> None:
        """By shared memory all arrive. By socket the publisher keeps the newest, as many as its depth."""
        subscription = await node.create_subscription(Int32, "t", 100)
        publisher = await node.create_publisher(Int32, "t", 3)
        daemon.kill()
        await until(lambda: not publisher._core.id)
        for number in range(10):
            publisher.publish(Int32(data=number))
            await asyncio.sleep(0)
        daemon.restart()
        lost = 7 if route == "socket" else 0
        assert [(await subscription.receive())[0].data for _ in range(lost, 10)] == list(range(lost, 10))
        assert publisher.statistics().replaced == lost
        await until(lambda: sum(subscription.statistics().dropped.values()) == lost)

    async def test_history_survives_without_duplicates(self, daemon: Daemon, node: bus.Node) -> None:
        heard: list[int] = []
        subscription = await node.create_subscription(
            Int32, "t", LATCHED, lambda message: heard.append(message.data)
        )
        publisher = await node.create_publisher(Int32, "t", LATCHED)
        for number in range(4):
            publisher.publish(Int32(data=number))
        await until(lambda: len(heard) == 4)
        daemon.kill()
        await until(lambda: not publisher._core.id)
        publisher.publish(Int32(data=4))
        publisher.publish(Int32(data=5))
        daemon.restart()
        await until(lambda: len(heard) == 6)
        await until_restarted(daemon, publisher, subscription)
        late = await node.create_subscription(Int32, "t", LATCHED)
        assert [(await late.receive())[0].data for _ in range(5)] == [1, 2, 3, 4, 5]
        assert heard == [0, 1, 2, 3, 4, 5]

    async def test_back_pressure_survives(self, daemon: Daemon, node: bus.Node) -> None:
        """The new broker unblocks a keep-all publisher that waits for room; the order is kept."""
        keep_all = bus.QoSProfile(history="keep_all")
        subscription = await node.create_subscription(Int32, "t", keep_all)
        publisher = await node.create_publisher(Int32, "t", keep_all)

        async def talk() -> None:
            for number in range(150_000):
                await publisher.send(Int32(data=number))

        talking = asyncio.ensure_future(talk())
        heard = [(await subscription.receive())[0].data]
        await until_restarted(daemon, publisher, subscription)
        while heard[-1] != 149_999:
            heard.append((await subscription.receive())[0].data)
        await talking
        assert heard == sorted(set(heard))
        await until(lambda: len(heard) + sum(subscription.statistics().dropped.values()) >= 150_000)

    async def test_between_processes(
        self, daemon: Daemon, node: bus.Node, program: Callable[..., subprocess.Popen[str]]
    ) -> None:
        subscription = await node.create_subscription(Int32, "count", 1000)
        talkers = [program(TALKER, f"talker{number}") for number in range(3)]
        for _ in range(2):
            await until_nodes(node, "talker0", "talker1", "talker2")
            await subscription.wait_for_publishers(3)
            daemon.kill()
            await until(lambda: not subscription._core.id)
            daemon.restart()
            await subscription.receive()
        for talker in talkers:
            assert talker.poll() is None

    @pytest.mark.parametrize("loop", ["uvloop", "asyncio"])
    def test_one_that_was_stopped_does_not_blame_the_others(
        self,
        loop: str,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        start_daemon: Callable[..., Daemon],
    ) -> None:
        """Their messages wait in the sockets, and busd reads them before it checks leases."""
        if loop == "asyncio":
            (tmp_path / "uvloop.py").write_text("raise ImportError('hidden by a test')\n")
            path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
            monkeypatch.setenv("PYTHONPATH", path)
        (tmp_path / "busd.toml").write_text(f"[limits]\nlease_s = {LEASE_S / 2}\n")
        daemon = start_daemon("--config", str(tmp_path / "busd.toml"))

        async def wait_patiently() -> None:
            async with asyncio.timeout(WAIT_S), bus.Node("patient", arguments=[], rosout=False) as node:
                publisher = await node.create_publisher(Int32, "t")
                before = publisher._core.id
                daemon.process.send_signal(signal.SIGSTOP)
                await asyncio.sleep(LEASE_S)
                daemon.process.send_signal(signal.SIGCONT)
                await node.graph()
                assert publisher._core.id == before

        asyncio.run(wait_patiently())

    async def test_a_node_closed_while_it_is_away(self, daemon: Daemon) -> None:
        async with asyncio.timeout(WAIT_S):
            node = bus.Node("leaving", arguments=[])
            await node.open()
            publisher = await node.create_publisher(Int32, "t", LATCHED)
            subscription = await node.create_subscription(Int32, "t", 10)
            daemon.kill()
            await until(lambda: not publisher._core.id)
            publisher.publish(Int32(data=1))
            await node.close()
            with pytest.raises(bus.ConnectionClosed):
                publisher.publish(Int32(data=2))
            with pytest.raises(bus.ConnectionClosed):
                await subscription.receive()
        daemon.restart()
        async with asyncio.timeout(WAIT_S), bus.Node("watcher", arguments=[], rosout=False) as watcher:
            assert await nodes(watcher) == {"watcher"}

    async def test_what_waits_for_it_ends_with_the_node(self, daemon: Daemon) -> None:
        async with asyncio.timeout(WAIT_S):
            node = bus.Node("leaving", arguments=[], rosout=False)
            await node.open()
            publisher = await node.create_publisher(Int32, "t")
            daemon.kill()
            await until(lambda: not publisher._core.id)
            waiting = [
                asyncio.ensure_future(node.create_publisher(Int32, "other")),
                asyncio.ensure_future(node.graph()),
                asyncio.ensure_future(publisher.wait_for_subscriptions()),
            ]
            await asyncio.sleep(0)
            await node.close()
            for error in await asyncio.gather(*waiting, return_exceptions=True):
                assert isinstance(error, bus.ConnectionClosed)

    async def test_endpoints_made_while_it_is_away(self, daemon: Daemon, node: bus.Node) -> None:
        first = await node.create_publisher(Int32, "t")
        daemon.kill()
        await until(lambda: not first._core.id)
        making = asyncio.ensure_future(node.create_subscription(Int32, "t", 10))
        await asyncio.sleep(0)
        daemon.restart()
        subscription = await making
        first.publish(Int32(data=7))
        assert (await subscription.receive())[0].data == 7

    async def test_a_new_one_with_less_room(
        self, daemon: Daemon, node: bus.Node, tmp_path: Path, caplog: pytest.LogCaptureFixture
    ) -> None:
        """Endpoints without room there wait for it and log that; the others continue."""
        subscription = await node.create_subscription(Int32, "t", 10)
        publishers = [await node.create_publisher(Int32, "t", 10) for _ in range(3)]
        daemon.kill()
        await until(lambda: not subscription._core.id)
        (tmp_path / "busd.toml").write_text("[limits]\nendpoints_per_peer = 3\n")
        daemon.arguments = ("--config", str(tmp_path / "busd.toml"))
        daemon.restart()
        await until(lambda: "endpoints of a process: 3 of 3 in use" in caplog.text)
        assert [bool(one._core.id) for one in publishers] == [True, True, False]
        publishers[1].publish(Int32(data=2))
        assert (await subscription.receive())[0].data == 2
        await publishers[0].close()
        await until(lambda: publishers[2]._core.id)
        publishers[2].publish(Int32(data=3))
        assert (await subscription.receive())[0].data == 3
