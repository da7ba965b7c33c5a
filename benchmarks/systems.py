"""Which systems there are, as the parent starts them. What their processes do is in benchmarks.adapters."""

from collections.abc import Callable
from typing import NamedTuple

import msgspec

from benchmarks.harness import START_S, Child, Group
from benchmarks.work import Work


class System(NamedTuple):
    """A way to get messages from one process to another.

    `serve` starts the processes between the two, whose CPU time is the broker's; `missing` says why the
    system can't be measured here, or nothing.
    """

    name: str
    module: str
    serve: Callable[[Group, str], list[Child]]
    missing: Callable[[], str] = str

    def start_servers(self, group: Group) -> list[Child]:
        """Start what stands between the publisher and the subscriber."""
        group.environ["BENCH_FOLDER"] = str(group.folder)
        return self.serve(group, self.module)

    def start_role(self, group: Group, role: str, work: Work) -> Child:
        """Start the publisher or the subscriber; returns when it is ready."""
        child = group.start_python(role, "-m", self.module, role, msgspec.json.encode(work).decode())
        group.expect(child, "ready", within_s=START_S)
        return child


def _serve_bus(group: Group, module: str) -> list[Child]:
    return [group.start_busd()]


def _serve_relay(group: Group, module: str) -> list[Child]:
    relay = group.start_python("relay", "-m", module, "relay", "{}")
    group.expect(relay, "ready", within_s=START_S)
    return [relay]


BUS = System("busd, socket", "benchmarks.adapters.bus_socket", _serve_bus)
TWO_HOPS = System("two bare hops", "benchmarks.adapters.floor_two_hops", _serve_relay)
