"""bus.transport.stream without further descriptors. The tests use separate processes, as limits apply to a
process.
"""

import json
import subprocess
import sys

import pytest

from conftest import WAIT_S

PRELUDE = """
import asyncio, errno, json, os, resource, socket, sys
import uvloop
from bus.base.descriptor import Descriptor
from bus.transport.stream import Handlers, Stream, trusting
from bus.transport.stream_state import WriteEvent, WriteState
from bus.wire import messages as m
from bus.wire.outbox import Outbox
from bus.wire.session import Role, Session

SHARE = m.encode_frame(m.Share())

class CountingStream(Stream):
    writes = pauses = 0

    def _write(self):
        self.writes += 1
        super()._write()

    def _change_writing(self, event):
        self.pauses += event is WriteEvent.RETRY
        super()._change_writing(event)

def end(sock, came):
    sock.setblocking(False)
    handlers = Handlers(on_received=came, on_lost=print)
    return CountingStream(sock, Session(Role.BROKER), Outbox(), handlers, trusting)

def numbered(number):
    return Descriptor(os.eventfd(number))

async def until(condition):
    while not condition():
        await asyncio.sleep(0)

def run(main):
    with asyncio.Runner(loop_factory=getattr(sys.modules[sys.argv[1]], "new_event_loop")) as runner:
        print(json.dumps(runner.run(main)))
"""

WITHOUT_ROOM = """
async def main():
    mine, other = socket.socketpair()
    found, came = [], []
    sender, receiver = end(mine, print), end(other, lambda items: came.extend(items))
    sender.outbox.put(m.encode_frame(m.Hello(version=1)))
    pair = numbered(0), numbered(0)
    limit = os.dup(0) + 10
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    spare = []
    while True:
        try:
            spare.append(os.dup(0))
        except OSError:
            break
    for room in (0, 1, 2, 0):
        for number in spare[:room]:
            os.close(number)
        sender.outbox.put(SHARE, pair)
        sender.flush()
        came.clear()
        await until(lambda: any(not isinstance(item, m.Hello) for item in came))
        found.append(len(came[-1].descriptors))
        came.clear()
        for number in spare[:room]:
            assert os.dup(0) == number, "none is left open, so the same numbers are free"

    # The first message lost its batch, and its end comes in one read with the next, which has its own.
    numbers = [one.fileno() for one in pair]
    socket.send_fds(mine, [SHARE[:5]], numbers)
    await until(lambda: receiver.session.descriptors)
    for number in spare[:2]:
        os.close(number)
    mine.send(SHARE[5:])
    socket.send_fds(mine, [SHARE], numbers)
    await until(lambda: len(came) == 2)
    found.append([len(item.descriptors) for item in came])
    return found

run(main())
"""

ON_THEIR_WAY = """
MESSAGES, LIMIT = 100, 40

async def main():
    if os.geteuid() == 0:  # root may have any number on the way
        os.setuid(65534)
    resource.setrlimit(resource.RLIMIT_NOFILE, (LIMIT, LIMIT))
    mine, other = socket.socketpair()
    sender = end(mine, print)
    sender.outbox.put(m.encode_frame(m.Hello(version=1)))
    pair = numbered(0), numbered(0)
    for number in range(MESSAGES):
        sender.outbox.put(SHARE, pair)
        sender.outbox.put(m.encode_frame(m.Ping(number=number)))
    sender.flush()
    assert sender.writing is WriteState.PAUSED
    try:
        socket.send_fds(mine, [b"x"], [0])
    except OSError as error:
        found = [errno.errorcode[error.errno]]
    await until(lambda: sender.pauses == 3)
    assert sender.writes <= 3, "it waits, and does not try again and again"
    came = []

    def take(items):
        for item in items:
            came.append(item.number if isinstance(item, m.Ping) else len(getattr(item, "descriptors", "")))

    receiver = end(other, take)
    await until(lambda: len(came) == 1 + 2 * MESSAGES)
    assert came[1::2] == [2] * MESSAGES, came
    assert came[2::2] == list(range(MESSAGES))
    assert sender.writing is WriteState.OPEN
    return found

run(main())
"""


@pytest.mark.parametrize("loop", ["asyncio", "uvloop"])
@pytest.mark.parametrize(
    ("program", "expected"),
    [(WITHOUT_ROOM, [0, 0, 2, 0, [0, 2]]), (ON_THEIR_WAY, ["ETOOMANYREFS"])],
    ids=["the receiver has no room", "too many on their way"],
)
def test_out_of_descriptors(program: str, expected: list[object], loop: str) -> None:
    command = [sys.executable, "-c", PRELUDE + program, loop]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert not done.stderr
    assert json.loads(done.stdout) == expected
