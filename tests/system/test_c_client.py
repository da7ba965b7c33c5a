"""`clients/c` on a real busd: a peer in C at one end, and the library's node at the other, by both routes."""

import asyncio
import mmap
import resource
import signal
from pathlib import Path

import pytest

import bus
import c_programs
from bus import shm
from bus.msg.std_msgs import String
from bus.shm import segments
from c_programs import peer
from chaos.proxy import Proxy
from conftest import Daemon
from neighbours import with_limits
from programs import running_command
from raw_peer import RawPeer, data
from raw_peer import text as record
from semantics import KEEP_ALL, LATCHED, node, until, until_busd_has_all

__all__ = ["node"]

MANY = 3000
LONG = 1 << 20


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


def text(number: int, size: int = 0) -> String:
    head = f"{number} "
    return String(data=head + "x" * (size - len(head)))


def numbers(messages: list[String]) -> list[int]:
    return [int(message.data.split()[0]) for message in messages]


def memory_bytes(pid: int) -> int:
    """The resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * mmap.PAGESIZE


def descriptors_of(pid: int) -> set[int]:
    return {int(link.name) for link in Path(f"/proc/{pid}/fd").iterdir()}


async def receive(subscription: bus.Subscription[String], count: int) -> list[String]:
    return [(await subscription.receive())[0] for _ in range(count)]


async def account(node: bus.Node, topic: str) -> tuple[int, int]:
    """Samples expected by the only subscription of a topic, and the sum of their fates, by the graph."""
    (one,) = (await node.graph(statistics=True)).subscriptions_of(topic)
    found = one.statistics
    assert found is not None
    return found.expected, found.samples + found.queued + sum(found.dropped.values())


async def until_account(node: bus.Node, topic: str, expected: int) -> None:
    """Wait until the reports of both sides have come, and their sums agree."""
    async with asyncio.timeout(10):
        while await account(node, topic) != (expected, expected):  # noqa: ASYNC110
            await asyncio.sleep(0.05)


def test_the_library_takes_no_names_of_programs(programs: Path) -> None:
    """A program that links libbusd.a may have functions of its own with any name: `fail`, `flush`."""
    found = c_programs.run("nm", "--extern-only", "--defined-only", programs / "libbusd.a")
    names = {line.split()[-1] for line in found.splitlines() if len(line.split()) == 3}
    assert "busd_publish" in names
    foreign = [name for name in names if not name.startswith(("busd_", "__"))]
    assert foreign == [], "they belong into clients/c/src/prefixed.h"


async def test_all_arrives_in_order_from_python(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    async with peer(programs, tmp_path, "listen", "/t", "keep_all") as listener:
        publisher = await node.create_publisher(String, "/t", KEEP_ALL)
        await publisher.wait_for_subscriptions()
        for number in range(MANY):
            await publisher.send(text(number))
        await listener.line(f"^{MANY - 1} ")
        await until_account(node, "/t", MANY)
        await publisher.send(text(MANY))
        await until_account(node, "/t", MANY + 1)
        statistics = await listener.finish()
    assert listener.numbers == [*range(MANY + 1)]
    assert {line.split()[2] for line in listener.program.lines if line[:1].isdigit()} == {route}
    assert statistics["samples"] == statistics["expected"] == MANY + 1


async def test_all_arrives_in_order_from_c(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    subscription = await node.create_subscription(String, "/t", KEEP_ALL)
    async with peer(programs, tmp_path, "talk", "/t", str(MANY), "keep_all", "wait=1", "size=900") as talker:
        got = await receive(subscription, MANY)
        await talker.line("published")
        statistics = await talker.finish()
    assert numbers(got) == [*range(MANY)]
    assert statistics["samples"] == MANY
    assert statistics["by_ring"] == (route == "shm")


async def test_a_slow_listener_loses_by_its_depth_and_the_account_closes(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    async with peer(programs, tmp_path, "listen", "/t", "depth=5", "pause_ms=2") as listener:
        publisher = await node.create_publisher(String, "/t", 5)
        await publisher.wait_for_subscriptions()
        for number in range(MANY):
            publisher.publish(text(number))
            if number % 100 == 0:
                await asyncio.sleep(0.001)
        await listener.line(f"^{MANY - 1} ")
        await until_account(node, "/t", MANY)
        statistics = await listener.finish()
    assert listener.numbers == sorted(set(listener.numbers))
    assert len(listener.numbers) < MANY
    assert statistics["expected"] == statistics["samples"] + statistics["replaced"] + statistics["lost"]
    assert statistics["samples"] == len(listener.numbers)


async def test_a_flood_from_c_and_the_account_closes(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    subscription = await node.create_subscription(String, "/t", 5)
    async with peer(programs, tmp_path, "talk", "/t", str(MANY), "depth=5", "wait=1") as talker:
        await talker.line("published")
        last = -1
        while last != MANY - 1:
            (last,) = numbers(await receive(subscription, 1))
        await until_account(node, "/t", MANY)
        assert (await talker.finish())["samples"] == MANY


async def test_late_joiners_get_the_history(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    async with peer(programs, tmp_path, "talk", "/from_c", "9", "latched", "depth=3") as talker:
        await talker.line("published")
        subscription = await node.create_subscription(String, "/from_c", LATCHED)
        assert numbers(await receive(subscription, 3)) == [6, 7, 8]
    publisher = await node.create_publisher(String, "/to_c", LATCHED)
    for number in range(9):
        publisher.publish(text(number))
    await until_busd_has_all(publisher, node)
    async with peer(programs, tmp_path, "listen", "/to_c", "latched", "depth=4") as listener:
        await listener.line("^8 ")
        publisher.publish(text(9))
        await listener.line("^9 ")
        await listener.finish()
    assert listener.numbers == [5, 6, 7, 8, 9]


async def test_the_best_available_durability(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """A late joiner gets the history of publishers that keep one, and matches the others."""
    latched = await node.create_publisher(String, "/t", LATCHED)
    volatile = await node.create_publisher(String, "/t", 5)
    for number in range(9):
        latched.publish(text(number))
        volatile.publish(text(100 + number))
    await until_busd_has_all(latched, node)
    async with peer(programs, tmp_path, "listen", "/t", "best_available", "depth=4") as listener:
        await listener.line("^8 ")
        await volatile.wait_for_subscriptions()
        volatile.publish(text(200))
        await listener.line("^200 ")
        await listener.finish()
    assert listener.numbers == [5, 6, 7, 8, 200]


async def test_long_messages_both_ways(node: bus.Node, programs: Path, tmp_path: Path, route: str) -> None:
    """Each is longer than the one before, so rings grow."""
    sizes = [10, 5_000, 20_000, 100_000, LONG, 3 * LONG]
    async with peer(programs, tmp_path, "listen", "/t", "depth=100") as listener:
        publisher = await node.create_publisher(String, "/t", 100)
        await publisher.wait_for_subscriptions()
        for number, size in enumerate(sizes):
            publisher.publish(text(number, size))
        await listener.line(f"^{len(sizes) - 1} ")
        await listener.finish()
    lines = [line for line in listener.program.lines if line[:1].isdigit()]
    assert lines == [f"{number} {size} {route}" for number, size in enumerate(sizes)]
    subscription = await node.create_subscription(String, "/back", KEEP_ALL)
    async with peer(
        programs, tmp_path, "talk", "/back", "20", "keep_all", "wait=1", f"size={LONG}"
    ) as talker:
        got = await receive(subscription, 20)
        await talker.finish()
    assert [message.data for message in got] == [text(number, LONG).data for number in range(20)]


async def test_held_messages_stay_as_they_are(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """More of them than a match has pins, while the publisher goes around its ring many times."""
    async with peer(programs, tmp_path, "listen", "/t", "keep_all", "hold=9") as listener:
        publisher = await node.create_publisher(String, "/t", KEEP_ALL)
        await publisher.wait_for_subscriptions()
        for number in range(200):
            await publisher.send(text(number, 100_000))
        await listener.line("^190 ")
        await listener.finish()
    assert listener.numbers == [*range(200)]
    assert not [line for line in listener.program.lines if "broken" in line]


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
async def test_a_listener_without_a_free_descriptor_wakes_its_publisher(
    node: bus.Node, programs: Path, tmp_path: Path
) -> None:
    """It has room for the two descriptors of the match, and for none more."""
    async with peer(programs, tmp_path, "listen", "/t", "keep_all") as listener:
        pid = listener.program.process.pid
        used = descriptors_of(pid)
        second = [number for number in range(len(used) + 2) if number not in used][1]
        before = resource.prlimit(pid, resource.RLIMIT_NOFILE)
        resource.prlimit(pid, resource.RLIMIT_NOFILE, (second + 1, before[1]))
        publisher = await node.create_publisher(String, "/t", KEEP_ALL)
        await publisher.wait_for_subscriptions()
        for number in range(MANY):
            await publisher.send(text(number, 2000))
        await listener.line(f"^{MANY - 1} 2000 shm$")
        resource.prlimit(pid, resource.RLIMIT_NOFILE, before)
        await listener.finish()


@pytest.mark.parametrize("role", ["listen", "talk"])
async def test_a_killed_peer_leaves_the_graph_and_blocks_nothing(
    node: bus.Node, programs: Path, tmp_path: Path, route: str, role: str
) -> None:
    publisher = await node.create_publisher(String, "/t", KEEP_ALL)
    subscription = await node.create_subscription(String, "/back", KEEP_ALL)
    words = (
        ("listen", "/t", "keep_all")
        if role == "listen"
        else ("talk", "/back", "1000000", "keep_all", "wait=1")
    )
    async with peer(programs, tmp_path, *words) as killed:
        if role == "listen":
            await publisher.wait_for_subscriptions()
            for number in range(100):
                await publisher.send(text(number))
            killed.program.process.send_signal(signal.SIGSTOP)
            while publisher.publish(text(0, 10_000)):
                pass
        else:
            await receive(subscription, 10)
        killed.program.process.send_signal(signal.SIGKILL)
        await killed.program.end()
    async with asyncio.timeout(20):
        for number in range(MANY):
            await publisher.send(text(number, 1000))
        while len((await node.graph()).nodes) > 1:  # noqa: ASYNC110
            await asyncio.sleep(0.01)


async def test_another_busd_both_ways(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """A relay in C between two ends in Python. Nothing is lost, and nothing comes twice."""
    subscription = await node.create_subscription(String, "/back", KEEP_ALL)
    async with peer(programs, tmp_path, "relay", "/t", "/back", "keep_all") as relay:
        publisher = await node.create_publisher(String, "/t", KEEP_ALL)
        await publisher.wait_for_subscriptions()
        await subscription.wait_for_publishers()
        got: list[int] = []
        for start in (0, 100, 200):
            for number in range(start, start + 100):
                await publisher.send(text(number))
            if start == 100:
                daemon.kill()
                daemon.restart()
        async with asyncio.timeout(30):
            while not got or got[-1] != 299:
                got += numbers(await receive(subscription, 1))
        await relay.line("event 0: connected")
        await relay.finish()
        matches = [line for line in relay.events() if line.startswith(("event 3: ", "event 4: "))]
        assert sorted(line.split()[2] for line in matches) == ["/back", "/t"], matches
    assert got == sorted(set(got))
    assert got == [*range(300)]


@pytest.mark.landing
async def test_events_of_matches_that_do_not_return(daemon: Daemon, programs: Path, tmp_path: Path) -> None:
    """The next busd has ten seconds to make them again."""
    async with peer(programs, tmp_path, "relay", "/t", "/back") as relay:
        with RawPeer(daemon.path) as ends:
            node = ends.hello().node()
            ends.publisher(node, "/t")
            ends.subscription(node, "/back")
            await relay.line("^event 3: /t ")
            await relay.line("^event 3: /back ")
            daemon.kill()
        daemon.restart()
        await relay.line("^event 4: /t ")
        await relay.line("^event 4: /back ")
        await relay.finish()


async def test_a_publisher_with_the_number_of_one_that_has_left(
    daemon: Daemon, programs: Path, tmp_path: Path
) -> None:
    """The numbers of the next busd begin at 1 again, and the listener remembers publishers that have left."""
    async with peer(programs, tmp_path, "listen", "/t", "keep_all") as listener:
        with RawPeer(daemon.path) as stays, RawPeer(daemon.path) as leaves:
            stays.hello().write(data(stays.publisher(stays.node(), "/t", gid=b"s" * 16).id, record("1 ")))
            await listener.line("^1 ")
            node = leaves.hello().node()
            for _ in range(20):
                leaves.publisher(node, "/other")
            left = leaves.publisher(node, "/t").id
            leaves.write(data(left, record("2 ") * 5, count=5))
            await until(lambda: listener.numbers == [1, *[2] * 5])
            leaves.close()
            await listener.line("^event 4: ")
            daemon.kill()
        daemon.restart()
        await listener.line("^event 0: ")
        with RawPeer(daemon.path) as stays:
            node = stays.hello().node()
            while stays.publisher(node, "/other").id < left - 1:
                pass
            assert stays.publisher(node, "/t", gid=b"s" * 16, next_seq=2).id == left
            stays.write(data(left, record("3 "), first_seq=2))
            await listener.line("^3 ")
        await listener.finish()


async def test_an_orderly_restart_loses_nothing(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    subscription = await node.create_subscription(String, "/t", 1000)
    async with peer(programs, tmp_path, "talk", "/t", "100", "depth=100", "wait=1", "pause_ms=5") as talker:
        got = numbers(await receive(subscription, 20))
        daemon.stop()
        daemon.restart()
        got += numbers(await receive(subscription, 80))
        await talker.finish()
    assert got == [*range(100)]


async def test_publishing_without_a_busd(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """The newest messages wait for the next busd, as many as the depth."""
    async with peer(programs, tmp_path, "talk", "/t", "200", "depth=10", "pause_ms=5") as talker:
        daemon.kill()
        await talker.line("event 1: ")
        await talker.line("published")
        daemon.restart()
        await talker.line("event 0: ")
        statistics = await talker.finish()
    assert statistics["samples"] == 200
    assert (statistics["replaced"] > 0) == (route == "socket")
    assert statistics["queued"] <= 10


async def test_errors_say_why(node: bus.Node, programs: Path, tmp_path: Path) -> None:
    async def told(*words: str) -> str:
        async with running_command(tmp_path, programs / "peer", *words) as program:
            assert await program.end() == 1
            return "\n".join(program.lines)

    assert "'/a b'" in await told("listen", "/a b")
    assert "depth" in await told("talk", "/t", "1", "depth=100000000")
    assert "for subscriptions only" in await told("talk", "/t", "1", "best_available")


@pytest.mark.parametrize("settings", ["[limits]\nmessage_bytes = 1_000_000\n"])
async def test_a_message_above_the_limit_is_refused(daemon: Daemon, programs: Path, tmp_path: Path) -> None:
    async with peer(programs, tmp_path, "talk", "/t", "1", "size=3000000") as talker:
        found = await talker.line("^publish: .*")
    assert "a message of 3000006 bytes; the limit is 1000000" in found[0]


async def test_incompatible_qos_is_an_event(node: bus.Node, programs: Path, tmp_path: Path) -> None:
    await node.create_subscription(String, "/t", 10)
    async with peer(programs, tmp_path, "talk", "/t", "1", "best_effort") as talker:
        found = await talker.line("event 5: .*")
        await talker.finish()
    assert "/t does not match node /tester: RELIABILITY: " in found[0]


def refuse(*_: object) -> None:
    raise OSError("refused by the test")


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
async def test_a_subscription_that_refuses_the_ring_of_a_publisher_in_c(
    node: bus.Node, programs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The publisher sends again what was in its ring, and continues by socket."""
    monkeypatch.setattr(segments, "map_ring", refuse)
    subscription = await node.create_subscription(String, "/t", KEEP_ALL)
    async with peer(programs, tmp_path, "talk", "/t", "300", "keep_all", "pause_ms=1") as talker:
        assert numbers(await receive(subscription, 300)) == [*range(300)]
        await talker.line("event 6: /t: a subscription uses the socket now")
        statistics = await talker.finish()
    assert (statistics["matches"], statistics["by_ring"]) == (1, 0)


@pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
async def test_a_publisher_that_refuses_a_subscription_in_c(
    node: bus.Node, programs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The subscription takes what is in the ring, leaves it, and continues by socket."""
    monkeypatch.setattr(segments, "map_readers", refuse)
    publisher = await node.create_publisher(String, "/t", KEEP_ALL)
    async with peer(programs, tmp_path, "listen", "/t", "keep_all", "pause_ms=1") as listener:
        for number in range(300):
            await publisher.send(text(number))
            await asyncio.sleep(0)
        number, route = 299, ""
        while route != "socket":
            number += 1
            await publisher.send(text(number))
            route = (await listener.line(rf"^{number} \d+ (\w+)"))[1]
        await until_account(node, "/t", number + 1)
        statistics = await listener.finish()
    assert listener.numbers == [*range(number + 1)]
    assert (statistics["expected"], statistics["by_ring"]) == (number + 1, 0)


async def test_the_account_of_a_stopped_subscription_closes(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    """It reads nothing for a while, so samples are dropped in busd or in the ring."""
    async with peer(programs, tmp_path, "listen", "/t", "depth=5") as listener:
        publisher = await node.create_publisher(String, "/t", 5)
        await publisher.wait_for_subscriptions()
        publisher.publish(text(0))
        await listener.line("^0 ")
        listener.program.process.send_signal(signal.SIGSTOP)
        for number in range(1, 20):
            publisher.publish(text(number, 100_000))
            await asyncio.sleep(0.001)
        listener.program.process.send_signal(signal.SIGCONT)
        publisher.publish(text(20))
        await listener.line("^20 ")
        await until_account(node, "/t", 21)
        statistics = await listener.finish()
    assert statistics["samples"] + statistics["replaced"] + statistics["lost"] == 21
    assert listener.numbers == sorted(set(listener.numbers))


@pytest.mark.parametrize("leaves", ["before", "after"])
async def test_the_account_closes_without_the_publisher_of_a_lost_connection(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path, route: str, leaves: str
) -> None:
    """The publisher leaves before or after busd cuts off the stopped process, and busd tells the rest."""
    path = tmp_path / "proxy.sock"
    with Proxy(path, daemon.path) as proxy:
        async with peer(programs, tmp_path, "listen", "/t", "depth=1000", BUSD_SOCKET=str(path)) as listener:
            publisher = await node.create_publisher(String, "/t", 1000)
            await publisher.wait_for_subscriptions()
            publisher.publish(text(0))
            await listener.line("^0 ")
            listener.program.process.send_signal(signal.SIGSTOP)
            for number in range(1, 31):
                publisher.publish(text(number, 20_000))
                await publisher.flush()
            if leaves == "before":
                await publisher.close()
            await node.graph()  # busd has read all that
            proxy.hang_up()
            while len((await node.graph()).nodes) > 1:  # noqa: ASYNC110
                await asyncio.sleep(0.01)
            if leaves == "after":
                for number in range(31, 41):
                    publisher.publish(text(number, 20_000))
                await publisher.flush()
                await publisher.close()
            listener.program.process.send_signal(signal.SIGCONT)
            while not (await node.graph()).subscriptions_of("/t"):  # noqa: ASYNC110
                await asyncio.sleep(0.01)
            await until_account(node, "/t", 31 if leaves == "before" else 41)
            await listener.finish()


async def test_the_samples_of_a_publisher_that_breaks_and_returns_count_once(
    daemon: Daemon, node: bus.Node, programs: Path, tmp_path: Path
) -> None:
    """It returns under another number while its samples wait in busd for the stopped listener."""
    async with peer(programs, tmp_path, "listen", "/t", "depth=1000") as listener:
        with RawPeer(daemon.path) as first, RawPeer(daemon.path) as second:
            number = first.hello().publisher(first.node(), "/t", gid=b"s" * 16).id
            first.write(data(number, record("1 ")))
            await listener.line("^1 ")
            listener.program.process.send_signal(signal.SIGSTOP)
            for seq in range(2, 31):
                first.write(data(number, record("2 " + "x" * 20_000), first_seq=seq))
            first.barrier()
            first.close()
            number = second.hello().publisher(second.node(), "/t", gid=b"s" * 16, next_seq=36).id
            second.write(data(number, record("3 "), first_seq=36))
            second.barrier()
            listener.program.process.send_signal(signal.SIGCONT)
            await listener.line("^3 ")
            await until_account(node, "/t", 36)
            statistics = await listener.finish()
    assert listener.numbers == [1, *[2] * 29, 3]
    assert (statistics["samples"], statistics["lost"]) == (31, 5)


async def test_expired_messages_are_not_delivered(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    publisher = await node.create_publisher(String, "/t", bus.QoSProfile(history="keep_all", lifespan=0.2))
    async with c_programs.peer(programs, tmp_path, "listen", "/t", "keep_all", "pause_ms=500") as peer:
        await publisher.wait_for_subscriptions()
        for number in range(3):
            await publisher.send(text(number))
        async with asyncio.timeout(20):
            while 9 not in peer.numbers:
                await publisher.send(text(9))
                await asyncio.sleep(0.05)
        assert peer.numbers[:2] == [0, 9]
        assert (await peer.finish())["expired"] >= 2


async def test_a_message_with_the_time_of_its_source(
    node: bus.Node, programs: Path, tmp_path: Path, route: str
) -> None:
    publisher = await node.create_publisher(String, "/t", 10)
    async with c_programs.peer(programs, tmp_path, "listen", "/t") as peer:
        await publisher.wait_for_subscriptions()
        publisher.publish_encoded(b"\x91\xa27 ", source_time_ns=1_700_000_000_000_000_000)
        await peer.line(f"^7 2 {route}$")
        await peer.finish()


async def test_a_queue_is_bounded_beside_lossless_messages(
    node: bus.Node, programs: Path, tmp_path: Path
) -> None:
    """A lossless message waits in front. The oldest messages of the other publisher are dropped."""
    words = ("listen", "/t", "keep_all", "hold=1", "late=41")
    async with peer(programs, tmp_path, *words, BUS_ROUTE="socket") as listener:
        lossless = await node.create_publisher(String, "/t", KEEP_ALL)
        lossy = await node.create_publisher(String, "/t", 100)
        await lossless.wait_for_subscriptions()
        await lossy.wait_for_subscriptions()
        await lossless.send(text(1000))
        for number in range(40):
            lossy.publish(text(number, LONG))
            await lossy.flush()
        await listener.line("^38 ")
        statistics = await listener.finish()
    most = c_programs.INBOX_BYTES // LONG
    assert 2 < len(listener.numbers) <= 1 + most
    assert [*listener.numbers] == [1000, *range(41 - len(listener.numbers), 40)]
    assert statistics["lost"] == 41 - len(listener.numbers)


@with_limits(lease_s=1)
async def test_the_memory_of_a_large_message_is_given_back(
    node: bus.Node, programs: Path, tmp_path: Path
) -> None:
    """By socket it is received into memory of the connection, which keeps 1 MiB of it."""
    variables = {"BUS_ROUTE": "socket", "ASAN_OPTIONS": "quarantine_size_mb=0"}
    async with peer(programs, tmp_path, "listen", "/t", **variables) as listener:
        publisher = await node.create_publisher(String, "/t")
        await publisher.wait_for_subscriptions()
        publisher.publish(text(0))
        await listener.line("^0 ")
        pid = listener.program.process.pid
        before = memory_bytes(pid)
        publisher.publish(text(1, 32 * LONG))
        await listener.line("^1 ")
        await until(lambda: memory_bytes(pid) < before + 8 * LONG)
        publisher.publish(text(2, 4 * LONG))
        await listener.line("^2 ")
        await listener.finish()
