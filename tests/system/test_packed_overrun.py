"""A reader takes packs out of a ring while their writer, another process, overtakes it again and again."""

import os
import subprocess
import sys
from textwrap import dedent

import pytest

from bus_bridge.packed import RECORD

pytestmark = pytest.mark.landing

ends = pytest.importorskip("shm_ends", reason="the native core was not built")
_SIZE, _KINDS = 700, 256
"""The size of a payload, a good part of the ring's 4096 bytes. Each byte is the sample's number minus one."""

READER = f"""
    import sys
    from bus.base.descriptor import Descriptor
    from bus.shm import segments
    from bus_bridge.packed import Packed
    from shm_ends import Listener

    right = [bytes([number]) * {_SIZE} for number in range({_KINDS})]
    reader = Listener().reader
    reader.attach(1, segments.map_ring(Descriptor(int(sys.argv[1]))), 0, start=1)
    taken = 0
    while taken < 20_000 or reader.overrun < 20_000:
        pack = reader.take_packed(60_000, 10_000, 0)
        if pack is None:
            continue
        samples = Packed.read(pack[1], 1 << 48)
        for payload, number, _ in samples:
            assert payload == right[(number - 1) % {_KINDS}], f"{{number}} is torn"
        taken += samples.count
"""


def test_no_sample_of_it_is_torn() -> None:
    talker = ends.Talker(4096, 16, keep=1)
    pack = b"".join(RECORD.pack(0, 0, _SIZE) + bytes([number]) * _SIZE for number in range(_KINDS))
    command = [sys.executable, "-c", dedent(READER), str(talker.ring.number)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, pass_fds=[talker.ring.number], env=environment) as reader:
        while reader.poll() is None:
            assert talker.writer.publish_packed(pack, 0)[0] == _KINDS
    assert reader.returncode == 0
    talker.close()
