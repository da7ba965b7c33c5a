"""What the machine gives: descriptors, memory, socket buffers, clocks."""

import resource
import socket
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from bus.cli.doctor import procfs
from bus.cli.doctor.finding import FULL, Finding, ok, warn

__all__ = ["ClockWatch", "limits", "memory"]

_MIN_FILES = 1024
_MIN_SEND_BUFFER = 100_000
_MIN_FREE = 256 << 20
_RELEASED_S = 1_735_689_600
"""2025-01-01: a clock that shows less is not set."""
_JUMP_S = 0.05


def limits() -> Iterator[Finding]:
    """Of this process, which are mostly those of all that the user starts, and of the machine."""
    files, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if files < _MIN_FILES:
        may_raise = f"ulimit -n {most if most > 0 else _MIN_FILES}"
        must_ask = "LimitNOFILE= in a systemd unit, or nofile in /etc/security/limits.conf"
        yield warn("open files", f"limit {files}", must_ask if files == most else may_raise)
    else:
        yield ok("open files", f"limit {files}")
    used, all_files = procfs.number_in("/proc/sys/fs/file-nr"), procfs.number_in("/proc/sys/fs/file-max")
    if used is not None and all_files is not None and used > FULL * all_files:
        advice = f"sysctl -w fs.file-max={2 * all_files}"
        yield warn("open files", f"the whole machine has {used} of {all_files} in use", advice)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        size = probe.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
    if size < _MIN_SEND_BUFFER:
        advice = "sysctl -w net.core.wmem_default=212992"
        yield warn("socket buffer", f"{size} bytes; large messages will be slow", advice)
    else:
        yield ok("socket buffer", f"{size} bytes")


def memory(limits: Mapping[str, int | float]) -> Iterator[Finding]:
    """Whether busd may hold more for a user, by its `limits`, than there is."""
    free_kib = procfs.number_in("/proc/meminfo", "MemAvailable:")
    if free_kib is None:
        return
    free = free_kib << 10
    held = int(limits.get("queued_bytes_per_user", 0) + limits.get("history_bytes_per_user", 0))
    if free < max(held, _MIN_FREE):
        need = f"; busd may hold {held >> 20} MiB for one user" if held > free else ""
        advice = "lower limits.queued_bytes_per_user in busd.toml" if held > free else "end what needs it"
        yield warn("memory", f"{free >> 20} MiB are free{need}", advice)
    else:
        yield ok("memory", f"{free >> 20} MiB are free")


class ClockWatch:
    """Looks at the clocks when it is made and again in the end."""

    def __init__(self) -> None:
        self._ahead_s = _ahead_s()

    def finding(self) -> Finding:
        """Whether stamps can be trusted."""
        if time.time() < _RELEASED_S:
            text = f"the clock shows {time.strftime('%Y-%m-%d', time.gmtime())}: stamps will be wrong"
            return warn("clock", text, "set it, or run an NTP client")
        jump_s = _ahead_s() - self._ahead_s
        if abs(jump_s) > _JUMP_S:
            text = f"it was set by {jump_s:+.3f} s just now: stamps and lifespans jump with it"
            return warn(
                "clock", text, "let an NTP client slew it (chronyd), and set it before programs start"
            )
        sources = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
        try:
            source = f", from {sources.read_text().strip()}"
        except OSError:
            source = ""
        resolution_ns = time.get_clock_info("monotonic").resolution * 1e9
        return ok("clock", f"set; the monotonic one counts in steps of {resolution_ns:.0f} ns{source}")


def _ahead_s() -> float:
    """By how much the clock on the wall is ahead of the monotonic one.

    The most of some tries: less comes out where this process stood still between its two looks.
    """
    return max(time.time() - time.monotonic() for _ in range(5))
