"""Access of real users by the rules of busd.toml: allowed actions work, and each denial is reported."""

import subprocess
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import TypeAlias

import pytest

import bus
from bus.errors import AccessDenied, BrokerUnavailable
from bus.msg.std_msgs import String
from bus.wire import messages as m
from raw_peer import RawPeer
from semantics import until
from users import (
    GUEST,
    OWNER,
    STRANGER,
    TEAM,
    Guests,
    acting_as,
    needs_users,
    output_of,
    program,
    rule,
    running,
)

pytestmark = needs_users

ALL = ("publish", "subscribe", "observe")

Start: TypeAlias = Callable[..., Guests]
Join: TypeAlias = Callable[..., Awaitable[bus.Node]]

TALKER = """
import asyncio, sys, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("talker", rosout=False) as node:
        publisher = await node.create_publisher(String, "/chat", 10)
        await publisher.wait_for_subscriptions(1)
        print(publisher.matches[0].route, flush=True)
        publisher.publish(String(data="hello " + sys.argv[1]))
        await asyncio.to_thread(sys.stdin.readline)
bus.run(main())
"""

LISTENER = """
import bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("listener", rosout=False) as node:
        subscription = await node.create_subscription(String, "/chat", 10)
        print("ready", flush=True)
        print((await subscription.receive())[0].data, flush=True)
bus.run(main())
"""

RCLPY_NODE = """
import bus.rclpy_compat, rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("guest")
node.declare_parameter("speed", 1)
node.create_publisher(String, "/chat", 10).publish(String(data="hello"))
node.destroy_node()
rclpy.shutdown()
print("done")
"""

NATIVE_NODE = """
import bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("guest") as node:
        await node.declare_parameter("speed", 1)
        (await node.create_publisher(String, "/chat", 10)).publish(String(data="hello"))
bus.run(main())
print("done")
"""


def as_user(path: Path, uid: int, *groups: int) -> RawPeer:
    with acting_as(uid, *groups):
        return RawPeer(path)


@pytest.fixture
async def join() -> AsyncIterator[Join]:
    """Opens a node as if its process belonged to the given user, and closes it at the end."""
    async with AsyncExitStack() as nodes:

        async def join(busd: Guests, uid: int, name: str, *, rosout: bool = False) -> bus.Node:
            door = busd.door(uid)  # another path, because a process has one connection for each path
            node = bus.Node(name, arguments=[], socket=door, rosout=rosout)
            with acting_as(uid):
                await node.open()
            nodes.push_async_callback(node.close)
            return node

        yield join


def lines_of(log: str, text: str) -> list[str]:
    return [line for line in log.splitlines() if text in line]


class TestBetweenUsers:
    @pytest.mark.parametrize("wished", ["", pytest.param("socket", marks=pytest.mark.nightly)])
    def test_what_is_allowed_works(self, guests: Start, wished: str) -> None:
        """The two processes belong to two users; busd belongs to a third."""
        busd = guests(
            rule(f"users = [{GUEST}]", "/chat", "publish"),
            rule(f"users = [{STRANGER}]", "/chat", "subscribe"),
        )
        environment = {"BUSD_SOCKET": str(busd.path), "BUS_ROUTE": wished}
        with running(program(STRANGER, LISTENER, **environment)) as (listener, _):  # type: ignore[arg-type]
            assert listener.readline() == "ready\n"
            with running(program(GUEST, TALKER, "stranger", **environment)) as (talker, _):  # type: ignore[arg-type]
                assert talker.readline() == "socket\n"
                assert listener.readline() == "hello stranger\n"

    async def test_nobody_else_is_the_default(self, guests: Start, join: Join) -> None:
        busd = guests()
        with pytest.raises(BrokerUnavailable, match=f"user {GUEST}.* may not use the busd of user {OWNER}"):
            await join(busd, GUEST, "intruder")
        for uid in (OWNER, 0):
            await join(busd, uid, "welcome")

    def test_the_door_is_shut_with_a_reason_and_one_line_in_the_log(self, guests: Start) -> None:
        busd = guests(rule(f"users = [{GUEST}]", "/chat", "publish"))
        for _ in range(3):
            with as_user(busd.path, STRANGER, TEAM) as peer:
                text = peer.fault()
                assert f"user {STRANGER}, groups {STRANGER}, {TEAM} may not use" in text
                assert f"users = [{STRANGER}]" in text
        with as_user(busd.path, GUEST) as guest:
            guest.hello().barrier()
        assert len(lines_of(busd.log, "may not use")) == 1

    def test_groups_are_those_of_the_kernel(self, guests: Start) -> None:
        busd = guests(rule(f"groups = [{TEAM}]", "/chat", "publish"))
        for uid, groups, is_in in ((GUEST, (7, TEAM), True), (TEAM, (), True), (GUEST, (7,), False)):
            with as_user(busd.path, uid, *groups) as peer:
                if is_in:
                    assert isinstance(peer.hello().publisher(peer.node(), "/chat"), m.Created)
                else:
                    assert "may not use" in peer.fault()


class TestDenied:
    async def test_it_is_said_at_both_ends_and_in_the_log(
        self, guests: Start, join: Join, capfd: pytest.CaptureFixture[str]
    ) -> None:
        busd = guests(rule(f"users = [{GUEST}]", "/chat", "subscribe"))
        own = await join(busd, OWNER, "own")
        guest = await join(busd, GUEST, "guest")
        subscription = await own.create_subscription(String, "/chat", 10)
        text = f"user {GUEST} may not publish on '/chat': no rule of [[access]] in busd.toml allows it"
        for _ in range(2):
            with pytest.raises(AccessDenied) as caught:
                await guest.create_publisher(String, "/chat", 10)
            assert str(caught.value) == text
        await own.graph()  # its answer arrives after the denial
        said = lines_of(capfd.readouterr().err, "was denied access")
        assert len(said) == 1 and "node /guest was denied access to '/chat'" in said[0] and text in said[0]
        await until(lambda: lines_of(busd.log, text))  # busd's log thread writes it
        (line,) = lines_of(busd.log, text)
        assert "/guest of " in line
        heard = await guest.create_subscription(String, "/chat", 10)  # everything else still works
        publisher = await own.create_publisher(String, "/chat", 10)
        publisher.publish(String(data="hello"))
        assert (await heard.receive())[0].data == (await subscription.receive())[0].data == "hello"

    async def test_a_node_whose_log_is_denied_goes_on(
        self, guests: Start, join: Join, capfd: pytest.CaptureFixture[str]
    ) -> None:
        busd = guests(rule(f"users = [{GUEST}]", "/chat", *ALL))
        guest = await join(busd, GUEST, "guest", rosout=True)
        guest.get_logger().info("hello")
        await guest.create_publisher(String, "/chat", 10)  # busd has answered about /rosout before
        err = capfd.readouterr().err
        assert len(lines_of(err, "the log of this node stays here")) == 1
        assert len(lines_of(err, "hello")) == 1

    @pytest.mark.parametrize("source", [RCLPY_NODE, NATIVE_NODE], ids=["rclpy", "native"])
    def test_a_node_works_without_what_it_has_by_itself(self, guests: Start, source: str) -> None:
        busd = guests(rule(f"users = [{GUEST}]", "/chat", *ALL))
        said = output_of(program(GUEST, source, BUSD_SOCKET=str(busd.path)))
        assert said.endswith("done\n"), said
        warnings = [
            "the log of this node stays here",
            "changes of parameters are told to nobody",
            "nobody else can read or set this node's parameters",
        ]
        if source is RCLPY_NODE:
            warnings.append("nobody else can ask what types this node uses")
        for warning in warnings:
            assert len(lines_of(said, warning)) == 1, said


class TestObserving:
    async def test_the_graph_is_of_what_may_be_observed(self, guests: Start, join: Join) -> None:
        busd = guests(
            rule(f"users = [{GUEST}]", "/open/*", "observe"), rule(f"users = [{GUEST}]", "/in", "publish")
        )
        own = await join(busd, OWNER, "own")
        secret = await join(busd, OWNER, "secret")
        guest = await join(busd, GUEST, "guest")
        await own.create_publisher(String, "/open/door", 10)
        await own.create_subscription(String, "/in", 10)
        await secret.create_publisher(String, "/closed/door", 10)
        await guest.create_publisher(String, "/in", 10)
        graph = await guest.graph(statistics=True)
        assert {node.full_name for node in graph.nodes} == {"/own", "/guest"}
        assert {one.topic for one in graph.publishers} == {"/open/door", "/in"}
        assert not graph.subscriptions and not graph.matches
        whole = await own.graph()
        assert len(whole.nodes) == 3 and len(whole.matches) == 1

    async def test_changes_come_without_what_is_hidden(self, guests: Start, join: Join) -> None:
        busd = guests(rule(f"users = [{GUEST}]", "/open", "observe"))
        with as_user(busd.path, GUEST) as guest:
            before: m.GraphSnapshot = guest.hello().ask(m.Observe(request=guest.request()))
            own = await join(busd, OWNER, "own")
            await own.create_publisher(String, "/closed", 10)
            await own.create_publisher(String, "/open", 10)
            await own.graph()
            guest.send(m.Ping(number=1))
            changes = []
            for item in guest.until_end():
                if isinstance(item, m.Pong):
                    break
                changes.append(item)
            assert [one.revision - before.revision for one in changes] == [*range(1, len(changes) + 1)]
            assert {one.topic for change in changes for one in change.endpoints_added} == {"/open"}
            assert [one.name for change in changes for one in change.nodes_added] == ["own"]


class TestOtherRules:
    async def test_what_is_not_allowed_any_more_ends_and_the_rest_of_the_node_goes_on(
        self, guests: Start, join: Join, route: str, capfd: pytest.CaptureFixture[str]
    ) -> None:
        kept = rule(f"users = [{GUEST}]", "/kept", "publish")
        busd = guests(kept, rule(f"users = [{GUEST}]", "/gone", "publish"))
        own = await join(busd, OWNER, "own")
        guest = await join(busd, GUEST, "guest")
        subscription = await own.create_subscription(String, "/kept", 10)
        publisher = await guest.create_publisher(String, "/kept", 10)
        gone = await guest.create_publisher(String, "/gone", 10)
        busd.reload(kept)
        with acting_as(GUEST):  # the guest reconnects meanwhile
            await until(lambda: isinstance(gone._core.refusal, AccessDenied))
        with pytest.raises(AccessDenied, match=f"user {GUEST} may not publish on '/gone'"):
            gone.publish(String(data="no"))
        await publisher.wait_for_subscriptions(1)
        publisher.publish(String(data="yes"))
        assert (await subscription.receive())[0].data == "yes"
        assert lines_of(capfd.readouterr().err, "the new busd refuses the publisher on '/gone'")
        assert lines_of(busd.log, "the access rules have changed")

    def test_who_may_nothing_any_more_is_cut_off(self, guests: Start) -> None:
        busd = guests(rule(f"users = [{GUEST}]", "/chat", "publish"))
        with as_user(busd.path, GUEST) as guest, as_user(busd.path, OWNER) as own:
            guest.hello()
            own.hello()
            busd.reload("")
            assert "its access rules have changed" in guest.fault()
            own.barrier()

    def test_a_mistake_leaves_the_rules_as_they_were(self, guests: Start) -> None:
        busd = guests(rule(f"users = [{GUEST}]", "/chat", "publish"))
        busd.write(rule('users = ["nobody-of-that-name"]', "/chat", "publish"))
        with as_user(busd.path, GUEST) as guest:
            guest.hello()
            busd.process.send_signal(1)
            busd.wait_for_log("there is no user 'nobody-of-that-name'")
            guest.barrier()


def test_the_command_line_says_what_is_denied(guests: Start) -> None:
    busd = guests(rule(f"users = [{GUEST}]", "/chat", "observe"))
    source = "from bus_cli.entry import main; main()"
    arguments = ("topic", "pub", "--once", "-w", "0", "/chat", "std_msgs/msg/String", "{data: hi}")
    process: subprocess.Popen[str] = program(GUEST, source, *arguments, BUSD_SOCKET=str(busd.path))
    said = output_of(process)
    assert process.returncode == 1, said
    assert f"user {GUEST} may not publish on '/chat'" in said and "Traceback" not in said
