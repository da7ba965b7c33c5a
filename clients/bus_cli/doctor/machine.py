"""Resources of the machine: descriptors, memory, socket buffers, clocks."""

import resource
import socket
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from bus.shm.headroom import Room, rooms
from bus_cli.doctor import procfs
from bus_cli.doctor.finding import FULL, Finding, ok, warn

__all__ = ["ClockWatch", "limits", "memory"]

_MIN_FILES = 1024
_MIN_SEND_BUFFER = 100_000
_MIN_FREE = 256 << 20
_RELEASED_S = 1_735_689_600
"""2025-01-01: a clock with an earlier time is not set."""
_JUMP_S = 0.05


def limits() -> Iterator[Finding]:
    """Limits of the machine and of this process, which are mostly the limits of all programs of the user."""
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


def memory(limits: Mapping[str, int | float], daemon: int | None = None) -> Iterator[Finding]:
    """Free memory here. If the process `daemon` is in another memory cgroup, also the free memory there.

    Warns if the `limits` of busd allow a user more memory than is free.
    """
    held = int(limits.get("queued_bytes_per_user", 0) + limits.get("history_bytes_per_user", 0))
    here = _narrowest("self")
    there = _narrowest(daemon) if daemon is not None else None
    is_one = there is None or here is None or there.where == here.where
    if here is not None:
        yield _left("", here, held if is_one else 0)
    if there is not None and not is_one:
        yield _left("the daemon: ", there, held)


def _narrowest(process: int | str) -> Room | None:
    return min(rooms(process), key=lambda room: room.left, default=None)


def _left(whose: str, room: Room, held: int) -> Finding:
    """Finding about the free memory in `room`; busd may hold `held` bytes of it for one user."""
    text = f"{whose}{room.left >> 20} of {room.limit >> 20} MiB of {room.where} are free"
    if room.left < held:
        text += f"; busd may hold {held >> 20} MiB for one user"
        return warn("memory", text, "lower limits.queued_bytes_per_user in busd.toml")
    if room.left <= max(room.reserve, min(_MIN_FREE, room.limit // 4)):
        return warn("memory", text, "stop programs that use it, or raise the limit")
    return ok("memory", text)


class ClockWatch:
    """Compares the clocks at its creation and again at the end, to find a jump."""

    def __init__(self) -> None:
        self._ahead_s = _ahead_s()

    def finding(self) -> Finding:
        """Finding about the clock: whether stamps are right."""
        if time.time() < _RELEASED_S:
            text = f"the clock shows {time.strftime('%Y-%m-%d', time.gmtime())}: stamps will be wrong"
            return warn("clock", text, "set it, or run an NTP client")
        jump_s = _ahead_s() - self._ahead_s
        if abs(jump_s) > _JUMP_S:
            text = f"it was just set by {jump_s:+.3f} s: stamps and lifespans jump with it"
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
    """Seconds by which the wall clock is ahead of the monotonic clock.

    The highest of several tries, because a pause between the two readings makes the result too low.
    """
    return max(time.time() - time.monotonic() for _ in range(5))
