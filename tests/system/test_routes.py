"""Routes of matches: the choice, both at once, a change from one to the other, and the ring's rules."""

import asyncio
import contextlib
import os
import shutil
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

import bus
from bus import shm
from bus.delivery.socket_sender import SocketSender
from bus.link.shm_context import ShmContext
from bus.msg.std_msgs import Int32, String
from bus.shm import segments
from conftest import WAIT_S, Daemon
from semantics import KEEP_ALL, node, send_all, until

__all__ = ["node"]

pytestmark = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())

OpenNode = Callable[..., AbstractAsyncContextManager[bus.Node]]
DURABLE = bus.QoSProfile(100_000, durability="transient_local")
"""A depth above the number of messages in any test, however slow other endpoints are."""


class Blob(msgspec.Struct):
    data: bytes = b""


@pytest.fixture
def open_node(daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> OpenNode:
    """Opens a node with its own connection, as if it were in another process."""

    @asynccontextmanager
    async def open_(name: str, **variables: str) -> AsyncIterator[bus.Node]:
        path = tmp_path / f"{name}.sock"
        path.symlink_to(daemon.path)
        node = bus.Node(name, socket=path, arguments=[], rosout=False)
        with monkeypatch.context() as patch:
            for variable, value in variables.items():
                patch.setenv(variable, value)
            await node.open()
        try:
            yield node
        finally:
            await node.close()

    return open_


@pytest.fixture
def public_daemon(monkeypatch: pytest.MonkeyPatch) -> Iterator[Daemon]:
    """A daemon whose socket other users may use."""
    folder = Path(tempfile.mkdtemp(prefix="busd-"))
    folder.chmod(0o755)
    monkeypatch.setenv("BUSD_SOCKET", str(folder / "busd.sock"))
    config = folder / "busd.toml"
    config.write_text(
        '[socket]\nmode = 0o666\n[[access]]\nusers = "*"\ntopics = "**"\nactions = ["publish", "subscribe"]\n'
    )
    daemon = Daemon(folder / "busd.sock", "--config", str(config))
    yield daemon
    assert "Traceback" not in daemon.stop()
    shutil.rmtree(folder)


def exit_status(child: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def numbers(first: int, stop: int) -> list[Int32]:
    return [Int32(data=number) for number in range(first, stop)]


async def talk(publisher: bus.Publisher[Int32]) -> None:
    """Publishes numbers, and lets other tasks run in between."""
    number = 0
    while True:
        await publisher.send(Int32(data=number))
        number += 1
        await asyncio.sleep(0)


async def hear(subscription: bus.Subscription[Int32], heard: list[int]) -> None:
    """Takes every message: a reader that does not would block a keep-all publisher."""
    while True:
        heard.append((await subscription.receive())[0].data)


async def take(subscription: bus.Subscription[Int32], count: int) -> list[int]:
    return [(await subscription.receive())[0].data for _ in range(count)]


def route_of(endpoint: bus.Publisher[Any] | bus.Subscription[Any]) -> list[str]:
    return [match.route for match in endpoint.matches]


class TestChoice:
    async def test_both_ends_and_the_graph_show_it(self, node: bus.Node, open_node: OpenNode) -> None:
        publisher = await node.create_publisher(Int32, "t", 10)
        async with open_node("far") as far:
            subscription = await far.create_subscription(Int32, "t", 10)
            await until(lambda: route_of(publisher) == route_of(subscription) == ["shm"])
            assert [match.route for match in (await node.graph()).matches] == ["shm"]

    @pytest.mark.parametrize("variable", [{"BUS_ROUTE": "socket"}, {"BUS_NATIVE": "no"}], ids=str)
    @pytest.mark.parametrize("who", ["publisher", "subscription"])
    async def test_one_side_that_shares_nothing_is_enough(
        self, node: bus.Node, open_node: OpenNode, variable: dict[str, str], who: str
    ) -> None:
        async with open_node("far", **variable) as far:
            here, there = (far, node) if who == "publisher" else (node, far)
            subscription = await there.create_subscription(Int32, "t", 10)
            publisher = await here.create_publisher(Int32, "t", 10)
            publisher.publish(Int32(data=1))
            assert await take(subscription, 1) == [1]
            assert route_of(publisher) == route_of(subscription) == ["socket"]

    @pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
    def test_another_users_process_shares_nothing(self, public_daemon: Daemon) -> None:
        asyncio.run(self.as_root())

    async def as_root(self) -> None:
        async with asyncio.timeout(WAIT_S), bus.Node("root", arguments=[], rosout=False) as node:
            publisher = await node.create_publisher(Int32, "down", KEEP_ALL)
            subscription = await node.create_subscription(Int32, "up", KEEP_ALL)
            child = os.fork()
            if not child:
                with contextlib.suppress(BaseException):
                    os.setgid(65534)
                    os.setuid(65534)
                    asyncio.set_event_loop(None)
                    asyncio._set_running_loop(None)
                    asyncio.run(self.as_nobody())
                    os._exit(0)
                os._exit(1)
            await publisher.wait_for_subscriptions()
            await subscription.wait_for_publishers()
            assert route_of(publisher) == route_of(subscription) == ["socket"]
            publisher.publish(Int32(data=7))
            assert await take(subscription, 1) == [8]
            assert exit_status(child) == 0

    async def as_nobody(self) -> None:
        async with bus.Node("nobody", arguments=[], rosout=False) as node:
            subscription = await node.create_subscription(Int32, "down", KEEP_ALL)
            publisher = await node.create_publisher(Int32, "up", KEEP_ALL)
            message, _ = await subscription.receive()
            assert route_of(publisher) == route_of(subscription) == ["socket"]
            publisher.publish(Int32(data=message.data + 1))
            await publisher.flush()


class TestBoth:
    """One publisher, read by its ring and by socket at the same time."""

    @pytest.mark.parametrize("qos", [KEEP_ALL, DURABLE], ids=["keep all", "transient local"])
    async def test_both_get_everything_once_and_in_order(
        self, node: bus.Node, open_node: OpenNode, qos: bus.QoSProfile
    ) -> None:
        publisher = await node.create_publisher(Int32, "t", qos)
        near = await node.create_subscription(Int32, "t", qos)
        async with open_node("far", BUS_ROUTE="socket") as far:
            distant = await far.create_subscription(Int32, "t", qos)
            sending = asyncio.create_task(send_all(publisher, numbers(0, 500)))
            assert await take(near, 500) == await take(distant, 500) == list(range(500))
            await sending
            assert sorted(route_of(publisher)) == ["shm", "socket"]
            assert near.statistics().dropped == distant.statistics().dropped == {}
            await distant.close()
            publisher.publish(Int32(data=500))
            assert await take(near, 1) == [500]
            again = await far.create_subscription(Int32, "t", qos)
            publisher.publish(Int32(data=501))
            heard = await take(again, 1)
            while heard[-1] != 501:
                heard += await take(again, 1)
            assert heard == list(range(heard[0], 502))
            assert heard[0] == 0 if qos is DURABLE else heard[0] >= 500  # 500 was still in transit

    async def test_a_late_one_by_socket_misses_nothing_that_is_published_later(
        self, node: bus.Node, open_node: OpenNode
    ) -> None:
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        near = await node.create_subscription(Int32, "t", KEEP_ALL)
        all_heard: list[int] = []
        hearing = asyncio.create_task(hear(near, all_heard))
        talking = asyncio.create_task(talk(publisher))
        async with open_node("far", BUS_ROUTE="socket") as far:
            for _ in range(30):
                late = await far.create_subscription(Int32, "t", KEEP_ALL)
                first = publisher.statistics().published
                heard = await take(late, 50)
                assert heard[0] <= first
                assert heard == list(range(heard[0], heard[0] + 50))
                await late.close()
        talking.cancel()
        await asyncio.gather(talking, return_exceptions=True)
        published = publisher.statistics().published
        await until(lambda: len(all_heard) >= published)
        hearing.cancel()
        assert all_heard == list(range(published))

    async def test_one_that_comes_while_a_loan_is_open(self, node: bus.Node, open_node: OpenNode) -> None:
        publisher = await node.create_publisher(Blob, "t", 10)
        near = await node.create_subscription(Blob, "t", 10)
        publisher.publish(Blob(b"before"))
        loan = publisher.loan(Blob(), "data", 5)
        assert loan is not None
        async with open_node("far", BUS_ROUTE="socket") as far:
            late = await far.create_subscription(Blob, "t", 10)
            await publisher.wait_for_subscriptions(2)
            loan.buffer[:] = b"lent!"
            loan.publish()
            publisher.publish(Blob(b"after"))
            assert [(await late.receive())[0].data for _ in range(2)] == [b"lent!", b"after"]
            assert [(await near.receive())[0].data for _ in range(3)] == [b"before", b"lent!", b"after"]

    @pytest.mark.parametrize("slow", ["ring", "socket"])
    async def test_the_slower_one_holds_a_publisher_back_that_keeps_all(
        self, node: bus.Node, open_node: OpenNode, slow: str
    ) -> None:
        count, most_ahead = 15_000, 10_000  # of 1000 bytes: more than a ring and a window hold
        publisher = await node.create_publisher(String, "t", KEEP_ALL)
        near = await node.create_subscription(String, "t", KEEP_ALL)
        async with open_node("far", BUS_ROUTE="socket") as far:
            distant = await far.create_subscription(String, "t", KEEP_ALL)
            late, quick = (near, distant) if slow == "ring" else (distant, near)
            texts = [String(data=f"{number:1000}") for number in range(count)]
            sending = asyncio.create_task(send_all(publisher, texts))
            heard: list[String] = []

            async def hear() -> None:
                heard.extend([(await quick.receive())[0] for _ in range(count)])

            hearing = asyncio.create_task(hear())
            for number in range(count):
                assert (await late.receive())[0] == texts[number]
                assert publisher.statistics().published - number <= most_ahead
            await sending
            await hearing
            assert heard == texts
            assert near.statistics().dropped == distant.statistics().dropped == {}


async def test_busd_dies_when_the_ring_of_one_that_has_gone_was_just_taken_to_its_end(
    daemon: Daemon, node: bus.Node, open_node: OpenNode
) -> None:
    async with open_node("far") as far:
        publisher = await far.create_publisher(Int32, "t", 10)
        subscription = await node.create_subscription(Int32, "t", 10)
        await publisher.wait_for_subscriptions()
        publisher.publish(Int32(data=1))
    await until(lambda: subscription.get_publisher_count() == 0)
    assert await take(subscription, 1) == [1]
    assert subscription.take() is None
    daemon.kill()
    daemon.restart()
    again = await node.create_publisher(Int32, "t", 10)
    await again.wait_for_subscriptions()
    again.publish(Int32(data=2))
    assert await take(subscription, 1) == [2]


async def test_what_was_taken_is_sent_once_when_there_is_memory(
    node: bus.Node, open_node: OpenNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise it would be published twice, and the ring's readers already have it."""
    publisher = await node.create_publisher(Int32, "t", 10)
    near = await node.create_subscription(Int32, "t", 10)
    hand_over, failures = SocketSender.hand_over, [MemoryError()]

    def fail(route: SocketSender) -> None:
        if route.open_samples and failures:
            raise failures.pop()
        hand_over(route)

    async with open_node("far", BUS_ROUTE="socket") as far:
        distant = await far.create_subscription(Int32, "t", 10)
        monkeypatch.setattr(SocketSender, "hand_over", fail)
        for number in range(3):
            assert publisher.publish(Int32(data=number))
        assert await take(near, 3) == await take(distant, 3) == [0, 1, 2]
        assert failures == []


def refuse(*_: object) -> Any:
    raise ValueError("not today")


class TestRerouted:
    """If an end can't use shared memory, messages go by socket: none is lost, repeated or out of order."""

    @pytest.fixture(params=["ring", "readers", "slot"])
    def broken(self, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
        """The broken part: the publisher's ring there, the readers' segment here, or all slots are taken."""
        if request.param == "slot":
            monkeypatch.setattr(ShmContext, "allot_slot", lambda self: None)
        else:
            monkeypatch.setattr(segments, f"map_{request.param}", refuse)
        return str(request.param)

    async def test_before_anything_was_read(self, daemon: Daemon, node: bus.Node, broken: str) -> None:
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        subscription = await node.create_subscription(Int32, "t", KEEP_ALL)
        for number in range(200):
            publisher.publish(Int32(data=number))
        assert await take(subscription, 200) == list(range(200))
        await until(lambda: route_of(publisher) == route_of(subscription) == ["socket"])
        publisher.publish(Int32(data=200))
        assert await take(subscription, 1) == [200]
        assert subscription.statistics().dropped == {}
        reason = "all slots" if broken == "slot" else "not today"
        await until(lambda: reason in daemon.log.read_text())
        assert "samples on '/t' from /tester to /tester go by socket: " in daemon.log.read_text()

    @pytest.mark.parametrize("qos", [KEEP_ALL, DURABLE], ids=["keep all", "transient local"])
    async def test_in_the_middle(
        self, node: bus.Node, open_node: OpenNode, broken: str, qos: bus.QoSProfile
    ) -> None:
        publisher = await node.create_publisher(Int32, "t", qos)
        for number in range(50):
            publisher.publish(Int32(data=number))
        async with open_node("far") as far:
            subscription = await far.create_subscription(Int32, "t", qos)
            sending = asyncio.create_task(send_all(publisher, numbers(50, 2000)))
            first = 0 if qos is DURABLE else 50
            assert await take(subscription, 2000 - first) == list(range(first, 2000))
            await sending
            await until(lambda: route_of(publisher) == route_of(subscription) == ["socket"])
            publisher.publish(Int32(data=2000))
            assert await take(subscription, 1) == [2000]
            assert subscription.statistics().dropped == {}

    @pytest.mark.parametrize("qos", [KEEP_ALL, DURABLE], ids=["keep all", "transient local"])
    async def test_while_others_go_by_socket(
        self, node: bus.Node, open_node: OpenNode, broken: str, qos: bus.QoSProfile
    ) -> None:
        """The publisher resends messages to the late subscription, although the others already have them."""
        publisher = await node.create_publisher(Int32, "t", qos)
        async with open_node("plain", BUS_ROUTE="socket") as plain, open_node("far") as far:
            other = await plain.create_subscription(Int32, "t", qos)
            talking = asyncio.create_task(talk(publisher))
            heard: list[int] = []
            hearing = asyncio.create_task(hear(other, heard))
            await until(lambda: len(heard) >= 100)
            subscription = await far.create_subscription(Int32, "t", qos)
            first = publisher.statistics().published
            late = await take(subscription, first + 300)
            talking.cancel()
            assert late[0] == 0 if qos is DURABLE else late[0] <= first
            assert late == list(range(late[0], late[0] + len(late)))
            await until(lambda: heard[-1] >= late[-1])
            hearing.cancel()
            assert heard == list(range(len(heard)))
            assert subscription.statistics().dropped == other.statistics().dropped == {}

    async def test_when_the_ring_grows(self, node: bus.Node, monkeypatch: pytest.MonkeyPatch) -> None:
        publisher = await node.create_publisher(Blob, "t", KEEP_ALL)
        subscription = await node.create_subscription(Blob, "t", KEEP_ALL)
        await until(lambda: route_of(publisher) == ["shm"])
        sizes = [10, 100, 8 << 20, 10, 9 << 20, 10]
        monkeypatch.setattr(segments, "map_ring", refuse)

        async def talk() -> None:
            for size in sizes:
                await publisher.send(Blob(bytes(size)))

        talking = asyncio.create_task(talk())
        assert [len((await subscription.receive())[0].data) for _ in sizes] == sizes
        await talking
        assert route_of(publisher) == route_of(subscription) == ["socket"]
        assert subscription.statistics().dropped == {}

    async def test_others_stay(
        self, node: bus.Node, open_node: OpenNode, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        publisher = await node.create_publisher(Int32, "t", KEEP_ALL)
        near = await node.create_subscription(Int32, "t", KEEP_ALL)
        publisher.publish(Int32(data=0))
        assert await take(near, 1) == [0]
        monkeypatch.setattr(segments, "map_ring", refuse)
        async with open_node("far") as far:
            distant = await far.create_subscription(Int32, "t", KEEP_ALL)
            await send_all(publisher, numbers(1, 100))
            assert await take(near, 99) == await take(distant, 99) == list(range(1, 100))
            assert (route_of(near), route_of(distant)) == (["shm"], ["socket"])
        publisher.publish(Int32(data=100))
        assert await take(near, 1) == [100]
