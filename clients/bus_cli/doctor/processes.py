"""Processes on the bus that stand still, use another release, or are near a limit."""

from collections.abc import Iterator, Mapping
from typing import Any

from bus.wire.messages import Peers
from bus_cli.doctor import procfs
from bus_cli.doctor.daemon import Seen
from bus_cli.doctor.finding import FULL, Finding, ok, warn

__all__ = ["examine"]

_SILENT_PART = 0.6
"""Longest normal silence, as a part of the lease: a healthy process sends three times in a lease."""

_UNITS = {"connections": "processes"}


def examine(seen: Seen) -> Iterator[Finding]:
    """Findings about processes with problems. Without problems, one finding for all processes."""
    found = [*_still(seen), *_releases(seen)]
    if seen.charges is not None:
        found += [*_near(seen.charges, len(seen.graph.topics())), *_refused(seen.charges)]
    if found:
        yield from found
    else:
        pids = {node.pid for node in seen.graph.nodes}
        yield ok("processes", f"{len(pids)} with nodes; all run, none is near a limit")


def _still(seen: Seen) -> Iterator[Finding]:
    """Connected processes that do not run."""
    silent_s = {peer.pid: peer.silent_s for peer in (seen.charges.peers if seen.charges else ())}
    names = {peer.pid: peer.program for peer in (seen.charges.peers if seen.charges else ())}
    for pid in sorted({*silent_s, *(node.pid for node in seen.graph.nodes)} - {0}):
        who = _who(names.get(pid, ""), pid)
        nodes = ", ".join(node.full_name for node in seen.graph.nodes if node.pid == pid)
        has = f" ({nodes})" if nodes else ""
        match procfs.state(pid):
            case "T" | "t":
                text = f"{who}{has} is stopped (SIGSTOP, Ctrl-Z or a debugger): it takes no messages"
                yield warn("processes", text, f"kill -CONT {pid}, or fg in its terminal")
            case "Z":
                text = f"{who}{has} has ended, but something still holds its connection"
                yield warn("processes", text, "end the processes that it has started")
            case _ if silent_s.get(pid, 0.0) > _SILENT_PART * seen.hello.lease_s > 0:
                text = f"{who}{has} was last heard {silent_s[pid]:.1f} s ago: its event loop stands still"
                yield warn("processes", text, "find the blocking call in its callbacks (py-spy dump)")


def _releases(seen: Seen) -> Iterator[Finding]:
    """Programs with another release of the library than the daemon."""
    differ = [
        peer
        for peer in (seen.charges.peers if seen.charges else ())
        if peer.nodes and peer.version != seen.hello.release
    ]
    for peer in differ:
        text = f"{_who(peer.program, peer.pid)} runs release {peer.version or 'unknown'} of the library, "
        yield warn("release", f"{text}the daemon {seen.hello.release or 'unknown'}", "start it again")


def _near(charges: Peers, topics: int) -> Iterator[Finding]:
    """Processes and users that use more than four fifths of a limit."""
    limits = charges.limits
    for peer in charges.peers:
        yield from _full(_who(peer.program, peer.pid), peer, "_per_peer", limits)
    for user in charges.users:
        yield from _full(f"uid {user.uid}", user, "_per_user", limits)
    connections = sum(user.connections for user in charges.users)
    for name, used in (("connections", connections), ("topics", topics)):
        yield from _use("the whole bus", name, used, name, limits)


def _full(who: str, record: Any, suffix: str, limits: Mapping[str, int | float]) -> Iterator[Finding]:
    for name in record.__struct_fields__:
        yield from _use(who, name, getattr(record, name), name + suffix, limits)


def _use(who: str, name: str, used: float, key: str, limits: Mapping[str, int | float]) -> Iterator[Finding]:
    most = limits.get(key)
    if most and used > FULL * most:
        what = _UNITS.get(name, name.replace("_", " "))
        text = f"{who} has {used:,.0f} of {most:,.0f} {what}"
        yield warn("limits", text, f"raise limits.{key} in busd.toml, or find out why it needs so much")


def _refused(charges: Peers) -> Iterator[Finding]:
    for peer in charges.peers:
        if peer.refused:
            times = "once" if peer.refused == 1 else f"{peer.refused:,} times"
            text = f"{_who(peer.program, peer.pid)} reached a limit {times}, and busd refused its request"
            yield warn("limits", text, "its log and busd's log name the limit")


def _who(program: str, pid: int) -> str:
    return f"{program or 'process'} (pid {pid})"
