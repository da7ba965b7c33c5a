"""What a hostile user can do with the memory that is shared with him: the claims of docs/security.md."""

import asyncio
import fcntl
import os
import select
import signal
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import AsyncExitStack, contextmanager
from types import FrameType
from typing import Self, TypeAlias

import pytest

import bus
from bus import shm
from bus.base.descriptor import Descriptor
from bus.link import shm_context
from bus.msg.std_msgs import String, UInt8MultiArray
from bus.shm import core, segments
from bus.wire import messages as m
from bus.wire.layout import GUESTS, VERSION
from conftest import WAIT_S
from raw_peer import RawPeer
from semantics import until
from users import GUEST, OWNER, STRANGER, Guests, acting_as, needs_users, output_of, program, rule

pytestmark = [needs_users, pytest.mark.skipif(not shm.is_available(), reason=shm.why_not() or "never")]

FULL = 2**64 - 2
SHARED = "shared_memory = true"

Join: TypeAlias = Callable[[int, str], Awaitable[bus.Node]]

BREAK_IN = """
import ctypes, fcntl, mmap, os, socket, sys
descriptors = socket.recv_fds(socket.socket(fileno=0), 1, 2)[1]
libc = ctypes.CDLL(None, use_errno=True)
def punch(fd):
    if libc.fallocate(fd, 3, ctypes.c_long(0), ctypes.c_long(4096)) < 0:
        raise OSError(ctypes.get_errno(), "fallocate")
def protect(fd):
    memory = mmap.mmap(fd, 4096, prot=mmap.PROT_READ)
    libc.mmap.restype = ctypes.c_void_p
    place = libc.mmap(None, ctypes.c_size_t(4096), 1, 1, fd, ctypes.c_long(0))
    if libc.mprotect(ctypes.c_void_p(place), ctypes.c_size_t(4096), 3) < 0:
        raise OSError(ctypes.get_errno(), "mprotect")
attempts = {
    "map it": lambda fd: mmap.mmap(fd, 4096),
    "make a mapping writable": protect,
    "write": lambda fd: os.pwrite(fd, b"x", 0),
    "shrink": lambda fd: os.ftruncate(fd, 0),
    "grow": lambda fd: os.ftruncate(fd, 1 << 30),
    "punch a hole": punch,
    "unseal or seal": lambda fd: fcntl.fcntl(fd, 1033, 8),
    "change its mode": lambda fd: os.fchmod(fd, 0o777),
    "open it anew": lambda fd: os.open(f"/proc/self/fd/{fd}", os.O_RDWR),
    "open it anew to read": lambda fd: os.open(f"/proc/self/fd/{fd}", os.O_RDONLY),
}
for fd in descriptors:
    mmap.mmap(fd, 4096, prot=mmap.PROT_READ)
    for what, attempt in attempts.items():
        try:
            attempt(fd)
        except OSError:
            continue
        print(os.readlink(f"/proc/self/fd/{fd}"), what)
print("tried", len(descriptors))
"""


@pytest.fixture
def guests() -> Iterator[Guests]:
    """A busd whose GUEST and STRANGER may do everything, with shared memory."""
    rules = [
        rule(f"users = [{GUEST}, {STRANGER}]", "**", "publish", "subscribe", "observe", more=SHARED),
    ]
    with Guests("".join(rules)) as busd:
        yield busd


class Ring:
    """A ring of GUEST's."""

    def __enter__(self) -> Self:
        with acting_as(GUEST):
            self.descriptor, _ = segments.make_ring(1 << 16, 512, 1)
        return self

    def __exit__(self, *_: object) -> None:
        self.descriptor.close()


class Hostile(RawPeer):
    """A raw peer of GUEST, with a doorbell and a readers' segment of its own, or one that it shows."""

    def __init__(self, busd: Guests, *, segment: Descriptor | None = None) -> None:
        with acting_as(GUEST):
            super().__init__(busd.path)
            self.segment, memory = segments.make_readers(8)
        self.doorbell = segments.make_doorbell()
        self.readers = core().Readers(memory, self.doorbell.number)
        self.send(m.Hello(version=VERSION, capabilities=(GUESTS,)))
        assert GUESTS in self.expect(m.Hello).capabilities
        self.carry(m.Share(), self.doorbell, segment or self.segment)

    def close(self) -> None:
        super().close()
        self.descriptors = ()
        self.doorbell.close()
        self.segment.close()

    def subscribe(self, topic: str, **fields: object) -> m.Matched:
        """A subscription that reads the publisher's ring, as far as busd knows."""
        created: m.Created = self.subscription(self.node(), topic, **fields)
        matched = self.expect(m.Matched)
        assert matched.route == "shm"
        self.send(m.Attach(subscription=created.id, source=matched.other, slot=0))
        return matched

    def publish(self, topic: str, ring: Descriptor) -> m.Created:
        """A publisher that has this ring."""
        fields = self.endpoint_fields(self.node(), topic, {"descriptors": 1})
        self.carry(m.CreatePublisher(**fields), ring)
        return self.expect(m.Created)


@contextmanager
def must_not_block() -> Iterator[None]:
    """A system call that blocks in here is interrupted, and fails the test."""
    blocked: list[bool] = []

    def note(number: int, frame: FrameType | None) -> None:
        blocked.append(True)

    before = signal.signal(signal.SIGALRM, note)
    signal.setitimer(signal.ITIMER_REAL, WAIT_S, 0.2)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert not blocked, "it blocked"


@pytest.fixture
async def join(guests: Guests) -> AsyncIterator[Join]:
    """Opens a node whose process and memory seem to be of that user, and closes it in the end."""
    async with AsyncExitStack() as nodes:

        async def join(uid: int, name: str) -> bus.Node:
            node = bus.Node(name, arguments=[], socket=guests.door(uid), rosout=False)
            with acting_as(uid):
                await node.open()
            nodes.push_async_callback(node.close)
            return node

        yield join


async def asleep(subscription: bus.Subscription[String]) -> "asyncio.Task[tuple[String, object]]":
    """What it hears next; it waits for it by now, and its process sleeps."""
    waiting = asyncio.create_task(subscription.receive())
    for _ in range(5):
        await asyncio.sleep(0)
    assert not waiting.done()
    return waiting


async def test_nobody_can_write_to_what_he_reads(join: Join) -> None:
    """Another user, who was given a ring and a readers' segment, tries everything on them."""
    own = await join(OWNER, "own")
    with acting_as(OWNER):
        publisher = await own.create_publisher(String, "/chat", 10)
    assert own._link is not None and own._link.shm_context is not None
    segment = own._link.shm_context.segment
    ours, theirs = socket.socketpair()
    with ours, theirs:
        process = program(GUEST, BREAK_IN, stdin=theirs.fileno())
        socket.send_fds(ours, [b"x"], [publisher._shared[0].fileno(), segment.fileno()])
        said = await asyncio.to_thread(output_of, process)
    assert said == "tried 2\n"
    assert os.fstat(publisher._shared[0].fileno()).st_uid == OWNER


async def test_a_doorbell_that_blocks_holds_nobody_up(guests: Guests, join: Join) -> None:
    """The subscriber fills its doorbell, takes O_NONBLOCK away, and sleeps."""
    own = await join(OWNER, "own")
    publisher = await own.create_publisher(String, "/chat", 10)
    with Hostile(guests) as guest:
        await asyncio.to_thread(guest.subscribe, "/chat")
        await publisher.wait_for_subscriptions(1)
        fcntl.fcntl(guest.doorbell.number, fcntl.F_SETFL, 0)
        os.eventfd_write(guest.doorbell.number, FULL)
        with must_not_block():
            for _ in range(20):
                guest.readers.sleep()
                publisher.publish(String(data="hello"))
        assert os.eventfd_read(guest.doorbell.number) > FULL


async def test_who_has_our_doorbell_can_neither_hold_us_up_nor_keep_us_asleep(
    guests: Guests, join: Join
) -> None:
    """A publisher takes O_NONBLOCK away from the subscriber's doorbell, and hushes it when it was rung."""
    own, talker = await join(OWNER, "own"), await join(STRANGER, "talker")
    with Hostile(guests) as guest, Ring() as ring:
        created = guest.publish("/bait", ring.descriptor)
        await own.create_subscription(String, "/bait", 10)
        attached = await asyncio.to_thread(guest.expect, m.Attached)
        assert (attached.publisher, attached.uid) == (created.id, OWNER)
        _, doorbell = guest.descriptors
        fcntl.fcntl(doorbell.number, fcntl.F_SETFL, 0)
        heard = await own.create_subscription(String, "/chat", 1000)
        publisher = await talker.create_publisher(String, "/chat", 1000)
        await publisher.wait_for_subscriptions(1)
        assert publisher.matches[0].route == "shm"
        with must_not_block():
            for number in range(2):
                waiting = await asleep(heard)
                publisher.publish(String(data=str(number)))
                if select.select([doorbell], [], [], 0)[0]:
                    os.eventfd_read(doorbell.number)  # before the loop that it is for can see it
                async with asyncio.timeout(WAIT_S):
                    assert (await waiting)[0].data == str(number)


@pytest.mark.parametrize("uid", [GUEST, OWNER])
async def test_what_another_user_writes_is_copied_before_it_is_decoded(join: Join, uid: int) -> None:
    """What stays in a foreign ring could change while it is looked at; what is one's own may stay there."""
    own, talker = await join(OWNER, "own"), await join(uid, "talker")
    subscription = await own.create_subscription(UInt8MultiArray, "/large", 10, views=True)
    publisher = await talker.create_publisher(UInt8MultiArray, "/large", 10)
    await publisher.wait_for_subscriptions(1)
    assert publisher.matches[0].route == "shm"
    publisher.publish(UInt8MultiArray(data=bytes(100_000)))
    message, _ = await subscription.receive()
    assert own._link is not None and own._link.shm_context is not None
    readers = own._link.shm_context.readers
    assert all(readers.is_free(slot) for slot in range(readers.slot_count)) == (uid == GUEST)
    assert len(message.data) == 100_000


async def test_a_segment_that_is_passed_off_as_ones_own_fools_nobody(
    guests: Guests, join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hostile reader names the readers' segment of the very process that it reads from."""
    monkeypatch.setattr(shm_context, "_WATCH_S", 3600.0)  # which would find what nobody was rung for
    own = await join(OWNER, "own")
    publisher = await own.create_publisher(String, "/chat", 10)
    assert own._link is not None and own._link.shm_context is not None
    with Hostile(guests, segment=own._link.shm_context.segment) as guest:
        await asyncio.to_thread(guest.subscribe, "/chat")
        await publisher.wait_for_subscriptions(1)
        heard = await own.create_subscription(String, "/chat", 10)
        await publisher.wait_for_subscriptions(2)
        for number in range(3):
            waiting = await asleep(heard)
            publisher.publish(String(data=str(number)))
            async with asyncio.timeout(WAIT_S):
                assert (await waiting)[0].data == str(number)


async def test_who_may_share_no_more_gets_nothing_of_what_is_published_then(
    guests: Guests, join: Join
) -> None:
    """The match goes on by socket, and ends where reading is denied too."""
    own, guest = await join(OWNER, "own"), await join(GUEST, "guest")
    publisher = await own.create_publisher(String, "/chat", 10)
    subscription = await guest.create_subscription(String, "/chat", 10)
    await publisher.wait_for_subscriptions(1)
    assert publisher.matches[0].route == "shm"
    guests.reload(rule(f"users = [{GUEST}]", "**", "subscribe"))
    await until(lambda: publisher.matches[0].route == "socket")
    publisher.publish(String(data="hello"))
    assert (await subscription.receive())[0].data == "hello"
    guests.reload("")
    with acting_as(GUEST):  # who would come back
        await until(lambda: not publisher.matches)
        publisher.publish(String(data="secret"))
    assert subscription.statistics().delivered == 1
