"""Limits of one user do not affect another: only the user who reaches a limit notices it."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from bus.qos import History, QoSProfile
from bus.wire import messages as m
from feeding import frame_record
from raw_peer import HELLO, RawPeer, data
from users import GUEST, OWNER, Guests, acting_as, needs_users, rule

pytestmark = needs_users

KEEP_ALL = QoSProfile(history=History.KEEP_ALL, reliability="best_effort")
KiB, MiB = 1 << 10, 1 << 20


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def come(stack: ExitStack) -> Callable[[Guests, int], RawPeer]:
    """Connects a peer of that user, which has sent nothing yet."""

    def come(busd: Guests, uid: int) -> RawPeer:
        with acting_as(uid):
            return stack.enter_context(RawPeer(busd.path))

    return come


def busd_with(stack: ExitStack, **limits: int) -> Guests:
    lines = "\n".join(f"{name} = {value}" for name, value in limits.items())
    everything = rule(f"users = [{GUEST}]", "/**", "publish", "subscribe", "observe")
    return stack.enter_context(Guests(f"[limits]\n{lines}\n{everything}"))


def test_what_is_counted(stack: ExitStack, come: Callable[[Guests, int], RawPeer]) -> None:
    busd = busd_with(stack, connections_per_user=3, endpoints_per_peer=4, endpoints_per_user=4)
    guests = [come(busd, GUEST).hello() for _ in range(3)]
    late = come(busd, GUEST)
    late.write(HELLO)
    assert late.fault() == (
        f"connections of user {GUEST}: 3 of 3 in use; busd's limit can be raised in busd.toml"
    )
    nodes = [guest.node() for guest in guests]
    for at in range(4):
        assert isinstance(guests[at % 3].publisher(nodes[at % 3], f"/t{at}"), m.Created)
    answer = guests[2].publisher(nodes[2], "/t")
    assert (answer.resource, answer.used, answer.limit) == (f"endpoints of user {GUEST}", 4, 4)
    owners = [come(busd, OWNER).hello() for _ in range(3)]
    node = owners[0].node()
    assert all(isinstance(owners[0].publisher(node, f"/t{at}"), m.Created) for at in range(4))
    seen = guests[0].ask(m.GetPeers(request=guests[0].request()))
    assert {one.uid for one in seen.peers} == {one.uid for one in seen.users} == {GUEST}
    seen = owners[0].ask(m.GetPeers(request=owners[0].request()))
    assert {one.uid: (one.connections, one.endpoints) for one in seen.users} == {GUEST: (3, 4), OWNER: (3, 4)}


def test_declarations(stack: ExitStack, come: Callable[[Guests, int], RawPeer]) -> None:
    few = {"nodes": 10, "endpoints": 5, "matches": 50, "declarations_per_s": 1}
    busd = busd_with(
        stack, **{f"{name}_per_{whose}": few[name] for name in few for whose in ("peer", "user")}
    )
    guest, owner = come(busd, GUEST).hello(), come(busd, OWNER).hello()
    for _ in range(100):
        answer = guest.ask(m.CreateNode(guest.request(), "n"))
        if isinstance(answer, m.Refused) and answer.resource.startswith("declarations"):
            break
    assert answer.resource == "declarations per second of a process"
    late = come(busd, GUEST).hello()
    answer = late.ask(m.CreateNode(late.request(), "n"))
    assert answer.resource in (f"declarations per second of user {GUEST}", f"nodes of user {GUEST}")
    assert isinstance(owner.publisher(owner.node(), "/t"), m.Created)


def test_bytes(stack: ExitStack, come: Callable[[Guests, int], RawPeer]) -> None:
    """busd does not drop samples queued for the owner's slow process because of the guest's queues."""
    busd = busd_with(
        stack,
        message_bytes=MiB,
        queued_bytes_per_peer=8 * MiB,
        queued_bytes_per_user=8 * MiB,
        lease_s=60,
    )
    sleepers = {
        uid: [come(busd, uid).hello() for _ in range(number)] for uid, number in ((GUEST, 3), (OWNER, 1))
    }
    ids = {
        uid: [one.subscription(one.node(), "/flood", qos=KEEP_ALL).id for one in those]
        for uid, those in sleepers.items()
    }
    talker = come(busd, OWNER).hello()
    publisher = talker.publisher(talker.node(), "/flood").id
    body = frame_record(bytes(60 * KiB), 1)
    for seq in range(1, 101):
        talker.write(data(publisher, body, first_seq=seq))
    talker.barrier()
    graph: m.GraphSnapshot = talker.ask(m.GetGraph(request=talker.request(), statistics=True))
    dropped = {one.id: one.statistics.dropped for one in graph.endpoints if one.statistics is not None}
    assert all(dropped[one].get("memory_limit", 0) > 10 for one in ids[GUEST])
    assert [dropped[one] for one in ids[OWNER]] == [{}]
