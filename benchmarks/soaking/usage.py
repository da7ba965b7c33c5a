"""The resources of a process now: memory, descriptors, threads, shared memory. Reads /proc."""

from pathlib import Path
from typing import NamedTuple

from benchmarks.harness import Child, Failure
from benchmarks.soaking.slope import Quantity

QUANTITIES = (
    Quantity("RSS MiB", step=2.0, per_hour=4.0, digits=1),
    Quantity("PSS MiB", step=2.0, per_hour=4.0, digits=1),
    Quantity("descriptors", step=2.0, per_hour=0.0),
    Quantity("threads", step=1.0, per_hour=0.0),
    Quantity("memfds", step=2.0, per_hour=0.0),
)
"""The quantities in `Usage`.

RSS is all resident memory. PSS only counts a part of a shared page, so it moves when processes come and go. A
step of 2 MiB is what an allocator may take at once; two descriptors or memfds are what a visitor has.
"""

_MIB = 1 << 20
_MEMFD = "/memfd:"


class Usage(NamedTuple):
    """Values in the order of `QUANTITIES`; a memfd counts once, whether it is open or mapped."""

    rss_mib: float
    pss_mib: float
    descriptors: float
    threads: float
    memfds: float


def usage_of(child: Child) -> Usage:
    """The usage now. Raises Failure if the process has ended."""
    folder = Path("/proc") / str(child.pid)
    try:
        rollup = (folder / "smaps_rollup").read_text().splitlines()
        threads = sum(1 for _ in (folder / "task").iterdir())
        mapped = (folder / "maps").read_text().splitlines()
        memfds = {line.split()[4] for line in mapped if _MEMFD in line}
        descriptors = 0
        for entry in (folder / "fd").iterdir():
            try:
                if str(entry.readlink()).startswith(_MEMFD):
                    memfds.add(str(entry.stat().st_ino))
                descriptors += 1
            except FileNotFoundError:
                pass  # closed in the meantime
    except OSError:
        raise Failure(child.describe_end()) from None
    kib = {line.split()[0]: int(line.split()[1]) for line in rollup if line.endswith(" kB")}
    return Usage(
        rss_mib=kib.get("Rss:", 0) * 1024 / _MIB,
        pss_mib=kib.get("Pss:", 0) * 1024 / _MIB,
        descriptors=float(descriptors),
        threads=float(threads),
        memfds=float(len(memfds)),
    )
