"""The numbers, answers and sizes of docs/ring.md are those of the headers in C and of the rings' sizes."""

import os
import re
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bus.base.descriptor import Descriptor
from bus.delivery.ring_size import FIRST_CAPACITY, RingSize
from bus.shm import has_core, segments
from bus.shm.segments import RING_HEAD_BYTES
from rows import for_each

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "ring.md").read_text()
SHM = ROOT / "clients" / "bus" / "shm"
HEADERS = {path.name: path.read_text() for path in SHM.glob("*.h")}
WORDS = " ".join(PAGE.split())
FORMS = {"8 bytes": "8s", "u32": "I", "u64": "Q"}


def constant(name: str) -> int:
    """A constant of the headers, defined as a macro."""
    found = re.search(rf"#define {name} \(?([^\n/)]+)", "".join(HEADERS.values()))
    assert found, name
    number, _, shift = found[1].replace("u", "").partition("<<")
    return int(number) << int(shift or 0)


def rows(*head: str) -> list[list[str]]:
    """The rows of the table with this head."""
    _, found, rest = PAGE.partition(f"| {' | '.join(head)} |\n")
    assert found, head
    lines = rest.splitlines()[1:]
    return [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in lines[: next(at for at, line in enumerate(lines) if not line.startswith("|"))]
    ]


@for_each(
    ("name", "text"),
    [
        ("READER_PINS", "one for each of the {} pin words"),
        ("RING_ADMITTED", "`admitted[n mod {}]`"),
        ("RING_LEAD", "The writer drops small records {} ahead"),
        ("RING_ALIGN", "to its end, a multiple of {} bytes"),
        ("FEW_RINGS", "If the two processes have more than {} matches"),
    ],
)
def test_numbers(name: str, text: str) -> None:
    assert text.format(constant(name)) in WORDS


def test_sizes_of_large_records() -> None:
    assert f"A large record ({constant('RING_LARGE') >> 10} KiB and more)" in WORDS
    assert f"{constant('RING_ASK') >> 20} MiB or more after the start" in WORDS
    assert "#define READER_TICKET (UINT64_C(1) << 63)" in HEADERS["layout.h"]
    assert "has bit 63, it contains a ticket" in WORDS


def test_answers_of_the_writer() -> None:
    reserve = HEADERS["writer.h"].partition("ring_reserve(struct")[2].partition("\n}\n")[0]
    returned = set(re.findall(r"return RING_(\w+);", reserve))
    assert {row[0] for row in rows("answer", "meaning", "the publisher's action")} == returned


def test_the_mark_of_a_sleep_for_room() -> None:
    """The formula of `wanted` stands in the header in the page's words."""
    assert "taken + (w->latest + 2 - taken) / 2" in HEADERS["writer.h"]
    assert "`taken` + (`latest` + 2 - `taken`)/2" in WORDS


@pytest.mark.skipif(not has_core(), reason="the native core was not built")
@for_each("row", rows("QoS", "message", "`keep`", "reason", "capacity", "index"))
def test_sizes(row: list[str]) -> None:
    qos, message, keep, reason, capacity, index = row
    size = int(message.split()[0])
    record = -(-(RING_HEAD_BYTES + size) // 64) * 64
    writer: Any = SimpleNamespace(capacity=FIRST_CAPACITY, latest=FIRST_CAPACITY // record, oldest=1)
    sizes = RingSize(lambda: 0, keeps_all=qos == "keep all")
    sizes.allow(64 << 20)
    grown = sizes.larger(writer, size if reason == "message" else 0, int(keep), must=reason == "message")
    assert grown == (int(capacity), int(index))


def geometry(memory: Descriptor, title: str) -> dict[str, int | str]:
    """The fields in a memory, by the table in that section of the page."""
    section = PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    found: dict[str, int | str] = {}
    for offset, name, form in re.findall(r"^\| (\d+) ([a-z ]+) \| ([\w ]+) \|", section, re.MULTILINE):
        size = struct.calcsize(FORMS[form])
        (value,) = struct.unpack(FORMS[form], os.pread(memory.number, size, int(offset)))
        found[name] = value.decode() if form == "8 bytes" else value
    return found


@pytest.mark.skipif(not has_core(), reason="the native core was not built")
def test_a_publishers_segment() -> None:
    memory, _ = segments.make_ring(4096, 64, 7)
    size = 640 + 8 * 64 + 4096
    assert geometry(memory, "A publisher's segment") == {
        "magic": "busdring",
        "version": 1,
        "header bytes": 640,
        "segment bytes": size,
        "capacity": 4096,
        "index length": 64,
        "index offset": 640,
        "data offset": 640 + 8 * 64,
        "first seq": 7,
    }
    assert os.fstat(memory.number).st_size == size == 5248
    rest = os.pread(memory.number, size, 64)
    oldest, latest = (struct.pack("<Q", number) for number in (7, 6))
    assert rest == bytes(64) + oldest + bytes(120) + latest + bytes(size - 264)
    memory.close()


@pytest.mark.skipif(not has_core(), reason="the native core was not built")
def test_a_process_s_readers_segment() -> None:
    memory, _ = segments.make_readers(1020)
    assert geometry(memory, "A process's readers' segment") == {
        "magic": "busdread",
        "version": 1,
        "header bytes": 256,
        "segment bytes": 65536,
        "slot count": 1020,
    }
    assert os.pread(memory.number, 1 << 17, 32) == bytes(65536 - 32)
    memory.close()
