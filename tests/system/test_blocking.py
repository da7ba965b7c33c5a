"""The API for scripts, without an event loop; interrupts, threads, forks and restarts of busd."""

import asyncio
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, assert_type

import msgspec
import pytest

import bus
from bus.link.link import Link
from bus.msg.rcl_interfaces import Log
from bus.msg.std_msgs import Int64, String
from bus.srv.example_interfaces import AddTwoInts
from bus.wire.runs import Buffer
from conftest import WAIT_S, Daemon
from programs import on_one_loop, running

pytestmark = pytest.mark.usefixtures("daemon")

LOSSLESS = bus.QoSProfile(history="keep_all")
IDLE_S = 0.05


@pytest.fixture
def node(daemon: Daemon) -> Iterator[bus.BlockingNode]:
    with bus.connect("script") as node:
        yield node


@contextmanager
def asyncio_node(name: str, *steps: Callable[[bus.Node], object]) -> Iterator[None]:
    """A node on asyncio in its own thread, during the block; it has run `steps` at the start."""
    ready, end = threading.Event(), threading.Event()

    async def live() -> None:
        async with bus.Node(name) as node:
            for step in steps:
                await step(node)  # type: ignore[misc]
            ready.set()
            await asyncio.to_thread(end.wait)

    thread = threading.Thread(target=lambda: asyncio.run(live()), name=name)
    thread.start()
    try:
        assert ready.wait(WAIT_S)
        yield
    finally:
        end.set()
        thread.join(WAIT_S)


class TestTopics:
    def test_what_is_published_is_heard_in_its_order(self, route: str, node: bus.BlockingNode) -> None:
        subscription = node.create_subscription(Int64, "numbers", 100)
        for number in range(100):
            node.publish("numbers", Int64(data=number))

        assert [message.data for message in subscription.listen(timeout=IDLE_S)] == list(range(100))
        assert subscription.matches[0].route == route

    def test_types_without_a_class(self, route: str, node: bus.BlockingNode) -> None:
        """mypy checks the types of the endpoints against the overloads."""
        schema = bus.MessageSchema.of(Int64)
        publisher = node.create_publisher(schema, "numbers")
        assert_type(publisher, bus.BlockingPublisher[Any])
        known = node.create_subscription(Int64, "numbers")
        assert_type(known, bus.BlockingSubscription[Int64])
        any_type = node.create_subscription(None, "numbers")
        assert_type(any_type, bus.BlockingSubscription[Any])
        raw = node.create_subscription(Int64, "numbers", raw=True)
        assert_type(raw, bus.BlockingSubscription[Any])
        named = node.create_subscription("std_msgs/msg/Int64", "numbers")
        described = node.create_subscription(schema, "numbers")

        data = msgspec.msgpack.encode(Int64(data=7))
        publisher.publish(data)

        for subscription in (known, any_type, named, described):
            assert subscription.receive(WAIT_S)[0] == Int64(data=7)
            assert subscription.matches[0].route == route
        assert raw.receive(WAIT_S)[0] == data

    def test_two_nodes_of_two_threads(self, route: str, node: bus.BlockingNode) -> None:
        def echo() -> None:
            with bus.connect("echo") as other:
                for message in other.listen(Int64, "ping"):
                    other.publish("pong", message)
                    if message.data == 9:
                        return

        thread = threading.Thread(target=echo)
        thread.start()
        answers = node.create_subscription(Int64, "pong")
        ping = node.create_publisher(Int64, "ping")
        ping.wait_for_subscriptions(timeout=WAIT_S)
        for number in range(10):
            ping.publish(Int64(data=number))
            message, info = answers.receive(timeout=WAIT_S)
            assert (message.data, info.publication_sequence_number) == (number, number + 1)
        thread.join(WAIT_S)

    def test_what_comes_between_two_waits_is_there(self, route: str, node: bus.BlockingNode) -> None:
        with pytest.raises(TimeoutError, match=r"no message on '/talk' within 0\.01 s"):
            node.wait_for_message(String, "talk", timeout=0.01)
        for text in ("one", "two"):
            node.publish("talk", String(data=text))
        assert node.wait_for_message(String, "talk", timeout=WAIT_S).data == "one"
        assert [message.data for message in node.listen(String, "talk", timeout=IDLE_S)] == ["two"]

    def test_the_depth_bounds_what_waits(self, route: str, node: bus.BlockingNode) -> None:
        latest = node.create_subscription(Int64, "numbers", 1)
        for number in range(10):
            node.publish("numbers", Int64(data=number))
        heard = [message.data for message in latest.listen(timeout=IDLE_S)]
        assert heard[-1] == 9 and len(heard) + latest.statistics().dropped["replaced"] == 10

    def test_a_full_topic_that_keeps_all_makes_publish_wait(self, route: str, node: bus.BlockingNode) -> None:
        subscription = node.create_subscription(String, "bulk", LOSSLESS)
        publisher = node.create_publisher(String, "bulk", LOSSLESS)
        text, sent = "x" * 500_000, 0
        with pytest.raises(TimeoutError, match=r"no room on '/bulk' within 0\.1 s"):
            while True:
                publisher.publish(String(data=text), timeout=0.1)
                sent += 1
        assert sum(1 for _ in subscription.listen(timeout=IDLE_S)) == sent
        publisher.publish(String(data="room again"), timeout=WAIT_S)
        assert subscription.receive(WAIT_S)[0].data == "room again"

    def test_it_leaves_at_once_though_the_script_makes_no_other_call(self, route: str) -> None:
        """A subscription made a moment ago wakes up, and no message of a burst waits for the next call."""
        heard: list[str] = []
        with bus.connect("talker") as node:
            publisher = node.create_publisher(String, "talk", 50)
            for turn in range(10):
                come = threading.Event()

                def hear(message: String, come: threading.Event = come, last: str = f"{turn} 19") -> None:
                    heard.append(message.data)
                    if message.data == last:
                        come.set()

                with asyncio_node(
                    "ear", lambda ear, hear=hear: ear.create_subscription(String, "talk", 50, hear)
                ):
                    for number in range(20):
                        publisher.publish(String(data=f"{turn} {number}"))
                    assert come.wait(WAIT_S)
        assert heard == [f"{turn} {number}" for turn in range(10) for number in range(20)]

    def test_two_subscriptions_of_one_node(self, route: str, node: bus.BlockingNode) -> None:
        """While the script waits for one subscription, messages for the other one are queued."""
        pings, pongs = (node.create_subscription(Int64, topic, 1000) for topic in ("ping", "pong"))

        async def talk(other: bus.Node) -> None:
            ping, pong = [await other.create_publisher(Int64, topic, 1000) for topic in ("ping", "pong")]
            await asyncio.gather(ping.wait_for_subscriptions(), pong.wait_for_subscriptions())
            for number in range(200):
                (ping if number % 3 else pong).publish(Int64(data=number))
                await asyncio.sleep(0.001)

        async def begin(other: bus.Node) -> None:
            tasks.append(asyncio.create_task(talk(other)))

        heard, tasks = list[int](), list[asyncio.Task[None]]()
        with asyncio_node("talker", begin):
            for number in range(200):
                heard.append((pings if number % 3 else pongs).receive(WAIT_S)[0].data)
        assert heard == list(range(200))
        assert pings.statistics().delivered + pongs.statistics().delivered == 200

    @pytest.mark.parametrize("timeout", [0.0, 0.004, 0.031])
    def test_the_time_of_a_wait_is_exact(self, route: str, node: bus.BlockingNode, timeout: float) -> None:
        subscription = node.create_subscription(Int64, "numbers")
        publisher = node.create_publisher(Int64, "numbers")
        took = []
        for number in range(20):
            publisher.publish(Int64(data=number))
            assert subscription.receive(WAIT_S)[0].data == number
            begin = time.monotonic()
            with pytest.raises(TimeoutError):
                subscription.receive(timeout)
            took.append(time.monotonic() - begin - timeout)
        assert min(took) >= -1e-6 and min(took) < 0.01

    @pytest.mark.parametrize("is_from_thread", [False, True])
    def test_nothing_waits_for_the_next_call(
        self, route: str, node: bus.BlockingNode, is_from_thread: bool
    ) -> None:
        """A burst, as collected until the end of a turn, and a message too large for the socket's buffer."""
        sizes, come = [1] * 20 + [4_000_000], threading.Event()
        heard: list[int] = []

        def hear(message: String) -> None:
            heard.append(len(message.data))
            if len(heard) == len(sizes):
                come.set()

        def publish() -> None:
            for size in sizes:
                publisher.publish(String(data="x" * size))

        publisher = node.create_publisher(String, "talk", 50)
        with asyncio_node("ear", lambda ear: ear.create_subscription(String, "talk", 50, hear)):
            publisher.wait_for_subscriptions(timeout=WAIT_S)
            if is_from_thread:
                sizes.pop()
                thread = threading.Thread(target=publish)
                thread.start()
                thread.join(WAIT_S)
            else:
                publish()
            assert come.wait(WAIT_S)
        assert heard == sizes

    def test_a_script_that_ends_at_once_has_been_heard(self, route: str) -> None:
        come: list[str] = []
        with asyncio_node(
            "ear",
            lambda ear: ear.create_subscription(
                String, "talk", 10, lambda message: come.append(message.data)
            ),
        ):
            for _ in range(5):
                with bus.connect("script") as node:
                    node.publish("talk", String(data="I was here"))
            with bus.connect("last") as node:  # its message is behind the others
                graph = node.wait_for_graph(lambda graph: not graph.publishers_of("/talk"), WAIT_S)
                assert len(graph.subscriptions_of("/talk")) == 1
        assert come == ["I was here"] * 5

    def test_a_history_is_with_busd_at_once(self, node: bus.BlockingNode) -> None:
        """The script may do something else from now on, and its event loop rests."""
        publisher = node.create_publisher(
            String, "latched", bus.QoSProfile(depth=3, durability="transient_local")
        )
        for word in ("for", "who", "comes later"):
            publisher.publish(String(data=word))
        assert publisher.statistics().queued == 0

    def test_nobody_heard_it(self, node: bus.BlockingNode, capfd: pytest.CaptureFixture[str]) -> None:
        node.publish("talk", String(data="hello?"))
        node.create_publisher(
            String, "latched", bus.QoSProfile(depth=1, durability="transient_local")
        ).publish(String(data="for who comes later"))
        node.close()
        said = capfd.readouterr().err
        assert said.count("reached nobody") == 1
        assert "a message was published on '/talk' and reached nobody: no subscription was there" in said

    def test_it_says_what_was_not_there_in_time(self, node: bus.BlockingNode) -> None:
        with pytest.raises(TimeoutError, match=r"0 of 1 subscriptions to '/talk' within 0\.01 s"):
            node.create_publisher(String, "talk").wait_for_subscriptions(timeout=0.01)
        with pytest.raises(TimeoutError, match=r"1 of 2 publishers of '/talk' within 0\.01 s"):
            node.create_subscription(String, "talk").wait_for_publishers(2, timeout=0.01)

    @pytest.mark.parametrize("timeout", [-1, float("nan"), "soon"])
    def test_a_wrong_timeout(self, node: bus.BlockingNode, timeout: float) -> None:
        with pytest.raises(bus.ConfigurationError, match=f"timeout {timeout!r} is not a number of seconds"):
            node.listen(String, "talk", timeout=timeout)


class TestServices:
    def test_a_call(self, route: str, node: bus.BlockingNode) -> None:
        def add(request: AddTwoInts.Request) -> AddTwoInts.Response:
            if request.a < 0:
                raise ValueError("no negative numbers")
            return AddTwoInts.Response(sum=request.a + request.b)

        def serve(server: bus.Node) -> object:
            return server.create_service(AddTwoInts, "add", add)

        with pytest.raises(bus.ServiceUnavailable, match="no server exists now"):
            node.call(AddTwoInts, "add", AddTwoInts.Request(a=1, b=2))
        with pytest.raises(TimeoutError, match=r"no server for '/add' within 0\.01 s"):
            node.wait_for_service(AddTwoInts, "add", timeout=0.01)
        with asyncio_node("adder", serve):
            node.wait_for_service(AddTwoInts, "add", timeout=WAIT_S)
            for number in range(10):
                assert node.call(
                    AddTwoInts, "add", AddTwoInts.Request(a=number, b=2), timeout=WAIT_S
                ).sum == (number + 2)

    def test_no_answer_in_time(self, node: bus.BlockingNode) -> None:
        async def never(request: AddTwoInts.Request) -> AddTwoInts.Response:
            await asyncio.Event().wait()
            raise AssertionError

        with asyncio_node("adder", lambda server: server.create_service(AddTwoInts, "add", never)):
            node.wait_for_service(AddTwoInts, "add", timeout=WAIT_S)
            with pytest.raises(TimeoutError, match=r"no answer of service '/add' within 0\.05 s"):
                node.call(AddTwoInts, "add", AddTwoInts.Request(), timeout=0.05)


class TestWhereItIsUsed:
    async def test_in_an_event_loop_it_says_the_right_way(self) -> None:
        with pytest.raises(bus.LocalProtocolError, match=r"use async with bus\.Node\('script'\) as node"):
            bus.connect("script")

    def test_other_threads_may_publish_and_nothing_else(self, route: str, node: bus.BlockingNode) -> None:
        subscription = node.create_subscription(Int64, "numbers", 1000)
        publisher = node.create_publisher(Int64, "numbers", 1000)
        refused: list[str] = []

        def work() -> None:
            for number in range(500):
                publisher.publish(Int64(data=number))
            try:
                subscription.receive(0)
            except bus.LocalProtocolError as error:
                refused.append(str(error))

        thread = threading.Thread(target=work)
        thread.start()
        numbers = [subscription.receive(WAIT_S)[0].data for _ in range(500)]
        thread.join(WAIT_S)
        assert numbers == list(range(500))
        assert refused == [
            "this node belongs to the thread that connected: in each thread make one with bus.connect"
        ]

    def test_another_thread_waits_for_room(self, route: str, node: bus.BlockingNode) -> None:
        subscription = node.create_subscription(String, "bulk", LOSSLESS)
        publisher = node.create_publisher(String, "bulk", LOSSLESS)
        text, sent, full = "x" * 500_000, [0], threading.Event()
        last = String(data="last")

        def work() -> None:
            with pytest.raises(TimeoutError, match=r"no room on '/bulk' within 0\.1 s"):
                while True:
                    publisher.publish(String(data=text), timeout=0.1)
                    sent[0] += 1
            full.set()
            publisher.publish(last)

        with ThreadPoolExecutor() as pool:
            working = pool.submit(work)
            assert full.wait(WAIT_S)
            heard = 0
            for message in subscription.listen(timeout=WAIT_S):
                if message.data == "last":
                    break
                heard += 1
            working.result(WAIT_S)
        assert heard == sent[0] > 0
        assert publisher.statistics().refused <= 2, "one for each call that found no room"

    def test_other_threads_may_log(
        self, node: bus.BlockingNode, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """The node's own thread logs at the same time, and is about to send its line."""

        def send_now(link: Link, frame: Buffer) -> bool:
            time.sleep(1e-4)  # lets other threads run
            return really_send(link, frame)

        really_send = Link.send_now
        monkeypatch.setattr(Link, "send_now", send_now)
        logs = node.create_subscription(Log, "/rosout", 10_000)

        def work(name: str) -> None:
            for number in range(200):
                node.get_logger().info(f"{name} {number}")

        threads = [threading.Thread(target=work, args=(name,)) for name in "abc"]
        for thread in threads:
            thread.start()
        work("d")
        found: dict[str, list[int]] = {name: [] for name in "abcd"}
        while sum(map(len, found.values())) < 800:
            name, _, number = logs.receive(WAIT_S)[0].msg.partition(" ")
            found[name].append(int(number))
        for thread in threads:
            thread.join(WAIT_S)
        assert found == {name: list(range(200)) for name in "abcd"}
        assert "lost busd" not in capsys.readouterr().err

    def test_after_a_fork(self, node: bus.BlockingNode) -> None:
        subscription = node.create_subscription(String, "talk")
        reads, writes = os.pipe()
        if not (pid := os.fork()):
            status = 1
            try:
                said = []
                for use in (lambda: node.publish("talk", String()), lambda: subscription.receive(0)):
                    try:
                        use()
                    except bus.ForkError as error:
                        said.append(str(error))
                node.close()
                with bus.connect("child") as own:
                    own.publish("talk", String(data="from the child"))
                os.write(writes, "\n".join(said).encode())
                status = 0
            finally:
                os._exit(status)
        os.close(writes)
        assert os.waitpid(pid, 0)[1] == 0
        with os.fdopen(reads) as pipe:
            assert pipe.read().count("made before a fork") == 2
        assert subscription.receive(WAIT_S)[0].data == "from the child"

    def test_a_closed_node(self, node: bus.BlockingNode) -> None:
        subscription = node.create_subscription(String, "talk")
        subscription.close()
        with pytest.raises(bus.ConnectionClosed, match="this subscription on '/talk' is closed"):
            next(iter(subscription))
        node.close()
        node.close()
        with pytest.raises(bus.ConnectionClosed, match="node /script is closed"):
            node.publish("talk", String())


def test_busd_dies_and_comes_back(route: str, daemon: Daemon, node: bus.BlockingNode) -> None:
    subscription = node.create_subscription(Int64, "numbers", 100)
    publisher = node.create_publisher(Int64, "numbers", 100)
    for number in range(3):
        daemon.kill()
        daemon.restart()
        while publisher.get_subscription_count() < 1:
            node.sleep(0.01)
        publisher.publish(Int64(data=number))
        assert subscription.receive(WAIT_S)[0].data == number


def test_a_script_that_does_something_else_for_a_minute_is_no_news(
    node: bus.BlockingNode, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its event loop does not run meanwhile. For a script that is normal, so busd logs nothing."""
    link = node._node._link
    assert link is not None and link.connection is not None
    link.connection.note_standstill(time.monotonic_ns() + 60 * 10**9)
    assert capfd.readouterr().err == ""


WAITS = {
    "listen": "for message in node.listen(String, 'talk'): pass",
    "listen for a while": "for message in node.listen(String, 'talk', timeout=0.001): pass",
    "publish and sleep": "node.publish('talk', String(data='x')); time.sleep(0.001)",
    "publish": "node.publish('talk', String(data='x'))",
    "wait for a service": "node.wait_for_service(AddTwoInts, 'add')",
    "sleep": "node.sleep(1000)",
}

PROGRAM = """\
import bus, time
from bus.msg.std_msgs import String
from bus.srv.example_interfaces import AddTwoInts

with bus.connect("script") as node:
    ear = node.create_subscription(String, "talk")
    try:
        print("up", flush=True)
        while True:
            {what}
    finally:
        node.publish("talk", String(data="farewell"))
        print("farewell", flush=True)
"""


@on_one_loop
@pytest.mark.parametrize(
    ("what", "number"),
    [*((what, signal.SIGINT) for what in WAITS), ("listen", signal.SIGTERM), ("publish", signal.SIGTERM)],
)
async def test_a_signal(what: str, number: signal.Signals, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(PROGRAM.format(what=WAITS[what]))
    async with running(tmp_path, script) as program:
        await program.line("^up$")
        os.kill(program.process.pid, number)
        assert await program.end() == -number
        assert program.lines == ["up", "farewell"]


@on_one_loop
async def test_a_program_that_catches_ctrl_c_goes_on(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import bus\n"
        "from bus.msg.std_msgs import String\n"
        "try:\n"
        "    with bus.connect('script') as node:\n"
        "        print('up', flush=True)\n"
        "        next(node.listen(String, 'talk'))\n"
        "except KeyboardInterrupt:\n"
        "    print('caught')\n"
        "raise LookupError('as ever')\n"
    )
    async with running(tmp_path, script) as program:
        await program.line("^up$")
        os.kill(program.process.pid, signal.SIGINT)
        assert await program.end() == 1
        assert program.lines[1] == "caught" and program.lines[-1] == "LookupError: as ever"
