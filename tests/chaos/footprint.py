"""The resources of a process, seen from outside."""

from collections import Counter
from pathlib import Path

from nursery import holdings, private_bytes

MOST_GROWTH_BYTES = 48 << 20
"""Memory that a process may hold in addition to its memory before the storms.

It is the allocators' share for a few messages of 4 MiB: encoded, decoded and waiting.
"""


class Footprint:
    """The resources of a process: descriptors and mappings by kind, threads, private memory."""

    def __init__(self, pid: int) -> None:
        found = holdings(pid)  # without files of the test, which have other names each time
        self.holdings = Counter({what: n for what, n in found.items() if not what.endswith(".ledger")})
        status = Path(f"/proc/{pid}/status").read_text()
        self.threads = int(status.partition("Threads:")[2].split()[0])
        self.memory_bytes = private_bytes(pid)

    def beyond(self, before: "Footprint") -> list[str]:
        """The resources that exceed `before`."""
        more = [f"has {count} {what} more" for what, count in (self.holdings - before.holdings).items()]
        if self.threads > before.threads:
            more.append(f"has {self.threads} threads, had {before.threads}")
        if (grown := self.memory_bytes - before.memory_bytes) > MOST_GROWTH_BYTES:
            more.append(f"has grown by {grown >> 20} MiB")
        return more
