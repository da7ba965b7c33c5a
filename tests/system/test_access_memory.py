"""Different users share no memory: no user gets the ring, readers' segment or doorbell of another user."""

import json
from typing import Any

import pytest

from bus import shm
from bus.shm import segments
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION
from raw_peer import RawPeer
from users import GUEST, OWNER, Guests, acting_as, needs_users, program, rule, running

pytestmark = [needs_users, pytest.mark.skipif(not shm.is_available(), reason=shm.why_not() or "never")]

EVERYTHING = rule(f"users = [{GUEST}]", "**", "publish", "subscribe", "observe", more="shared_memory = true")
"""A rule with the option by which earlier versions shared memory between users."""

NAMES = ("own", "one", "two")

MEMBER = """
import asyncio, bus, json, pathlib, sys
from bus.msg.std_msgs import String
ALL = bus.QoSProfile(history="keep_all")
def inodes():
    maps = pathlib.Path("/proc/self/maps").read_text().splitlines()
    return sorted({line.split()[4] for line in maps if "/memfd:" in line})
def doorbells():
    found = set()
    for path in pathlib.Path("/proc/self/fdinfo").iterdir():
        try:
            lines = path.read_text().splitlines()
        except OSError:
            continue
        found.update(line for line in lines if line.startswith("eventfd-id"))
    return sorted(found)
async def main():
    async with bus.Node(sys.argv[1]) as node:
        heard = await node.create_subscription(String, "/chat", ALL)
        publisher = await node.create_publisher(String, "/chat", ALL)
        await publisher.wait_for_subscriptions(3)
        await heard.wait_for_publishers(3)
        publisher.publish(String(data=sys.argv[1]))
        names = sorted([(await heard.receive())[0].data for _ in range(3)])
        routes = {one.node: one.route for one in publisher.matches}
        said = {"names": names, "routes": routes, "memory": inodes(), "doorbells": doorbells()}
        print(json.dumps(said), flush=True)
        await asyncio.to_thread(sys.stdin.read)
asyncio.run(main())
"""


@pytest.fixture
def busd(guests: Any) -> Guests:
    started: Guests = guests(EVERYTHING)
    return started


def test_processes_of_two_users_have_no_memory_and_no_doorbell_in_common(busd: Guests) -> None:
    """Three processes match each other losslessly; two of them belong to one user."""

    def member(uid: int, name: str) -> Any:
        return running(program(uid, MEMBER, name, BUSD_SOCKET=str(busd.path)))

    with member(OWNER, "own") as own, member(GUEST, "one") as one, member(GUEST, "two") as two:
        said = {
            name: json.loads(out.readline()) for name, (out, _) in zip(NAMES, (own, one, two), strict=True)
        }
    assert {tuple(each["names"]) for each in said.values()} == {("one", "own", "two")}
    assert said["own"]["routes"] == {"/own": "shm", "/one": "socket", "/two": "socket"}
    assert said["one"]["routes"] == {"/own": "socket", "/one": "shm", "/two": "shm"}
    for what in ("memory", "doorbells"):
        held = {name: {*each[what]} for name, each in said.items()}
        assert held["own"] and not held["own"] & (held["one"] | held["two"])
        assert held["one"] & held["two"]  # so the test does detect shared descriptors


def test_a_program_of_an_earlier_version_is_given_none(busd: Guests) -> None:
    """The program offers the old capability to share memory with other users, and shares its own memory."""
    with acting_as(OWNER):
        own = RawPeer(busd.path)
    with acting_as(GUEST):
        guest = RawPeer(busd.path)
        ring, _ = segments.make_ring(1 << 16, 512, 1)
        segment, _ = segments.make_readers(8)
    with own, guest:
        for peer in (own, guest):
            peer.send(m.Hello(version=PROTOCOL_VERSION, capabilities=("guests",)))
            assert "guests" not in peer.expect(m.Hello).capabilities
            doorbell = segments.make_doorbell()
            peer.carry(m.Share(), doorbell, segment)
            doorbell.close()
        for talker, listener, topic in ((own, guest, "/down"), (guest, own, "/up")):
            fields = talker.endpoint_fields(talker.node(), topic, {"descriptors": 1})
            talker.carry(m.CreatePublisher(**fields), ring)
            publisher = talker.expect(m.Created)
            subscription = listener.subscription(listener.node(), topic)
            for peer in (talker, listener):
                matched = peer.expect(m.Matched)
                assert (matched.route, matched.descriptors) == ("socket", 0)
            listener.send(m.Attach(subscription=subscription.id, source=publisher.id, slot=0))
            talker.carry(m.ReplaceRing(publisher=publisher.id), ring)
            talker.barrier()
            listener.barrier()
        for peer in (own, guest):
            assert peer.descriptors == () and not peer._session.descriptors
    ring.close()
    segment.close()


def test_the_log_says_that_the_rule_means_nothing_any_more(busd: Guests) -> None:
    busd.wait_for_log("access[0].shared_memory = true has no effect any more")
