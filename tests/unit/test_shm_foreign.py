"""Rings and doorbells of other users, who do with what they have whatever they can."""

import fcntl
import os
import subprocess
import sys

import pytest

from bus.shm import segments
from conftest import WAIT_S
from shm_ends import LARGE, Listener, Talker, core, is_rung, listener, talker

__all__ = ["listener", "talker"]

FULL = 2**64 - 2

HOSTILE = """
import fcntl, os, sys
from shm_ends import Listener, Talker, core
from bus.shm import segments
talker, listener = Talker(), Listener()
"""


def foreign(listener: Listener) -> object:
    return core.Bell(segments.map_readers(listener.segment), listener.doorbell.number, foreign=True)


def run(source: str) -> str:
    """What could block for ever, in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", HOSTILE + source]
    return subprocess.run(
        command, env=environment, capture_output=True, check=True, timeout=3 * WAIT_S
    ).stdout.decode()


def test_of_a_foreign_publisher_all_is_copied(talker: Talker, listener: Listener) -> None:
    slot = listener.join(talker, foreign=True)
    talker.write(b"short", bytes(LARGE))
    listener.readers.sleep()
    taken = listener.reader.messages(2, lambda payload: payload)
    assert [type(one) for one in taken] == [bytes, bytes]
    assert listener.readers.is_free(slot) and not talker.writer.has_pins(id(listener))
    grown = talker.grow(1 << 19)
    listener.reader.extend(1, segments.map_ring(grown))
    talker.write(bytes(LARGE))
    (later,) = listener.reader.messages(2, lambda payload: payload)
    assert type(later) is bytes
    grown.close()


def test_a_foreign_doorbell_is_rung_once_for_each_sleep(talker: Talker, listener: Listener) -> None:
    bell = foreign(listener)
    listener.join(talker, gate=False)
    talker.writer.add_gate(1, bell, 0, is_lossless=False)
    for _ in range(100):
        assert listener.readers.sleep() == []
        talker.write(b"a", b"b")
        assert is_rung(listener.doorbell)
        assert listener.readers.wake() == [listener]
        listener.take()
        assert not is_rung(listener.doorbell)


def test_a_foreign_publisher_is_rung_for_room(listener: Listener) -> None:
    talker = Talker(1 << 12, 16, keep=1 << 60)
    reader = core.Reader(listener.readers, "lossless", 0, tells_cursor=True)
    reader.attach(
        1, segments.map_ring(talker.ring), 5, doorbell=talker.doorbell.number, foreign=True, start=1
    )
    talker.writer.add_gate(1, listener.bell, 5, is_lossless=True)
    while talker.writer.write(bytes(64)) is True:
        pass
    assert talker.writer.wait_for_room()
    assert not is_rung(talker.doorbell)
    reader.messages(1000, bytes)
    assert is_rung(talker.doorbell)
    talker.close()


def test_no_doorbell_blocks_who_rings_it() -> None:
    said = run(f"""
bell = core.Bell(segments.map_readers(listener.segment), listener.doorbell.number, foreign=True)
talker.writer.add_gate(1, bell, 0, is_lossless=False)
fcntl.fcntl(listener.doorbell.number, fcntl.F_SETFL, 0)
os.eventfd_write(listener.doorbell.number, {FULL})
for _ in range(10):
    listener.readers.sleep()
    talker.write(b"x")
print(talker.writer.rung, os.eventfd_read(listener.doorbell.number) >= {FULL})
""")
    assert said == "10 True\n"


def test_no_doorbell_blocks_whose_it_is() -> None:
    said = run("""
listener.readers.is_wary = True
fcntl.fcntl(listener.doorbell.number, fcntl.F_SETFL, 0)
listener.join(talker)
listener.readers.sleep()
print(listener.readers.wake())
talker.write(b"x")
print(len(listener.readers.wake()))
""")
    assert said == "[]\n1\n"


def test_what_is_foreign_must_be_said_by_name(listener: Listener) -> None:
    memory = segments.map_readers(listener.segment)
    with pytest.raises(TypeError):
        core.Bell(memory, listener.doorbell.number, True)
    with pytest.raises(TypeError):
        core.Readers(memory, listener.doorbell.number, foreign=True)


def test_segments_can_be_opened_by_their_user_alone(talker: Talker, listener: Listener) -> None:
    for descriptor in (talker.ring, listener.segment):
        assert os.fstat(descriptor.number).st_mode & 0o777 == 0o600


def test_flags_are_as_they_were(listener: Listener) -> None:
    """What is foreign here is the manner of ringing; the doorbell itself stays as it is."""
    foreign(listener)
    assert fcntl.fcntl(listener.doorbell.number, fcntl.F_GETFL) & os.O_NONBLOCK
