"""The versions below the library: Python, packages, the native core."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from bus_cli.doctor.finding import Finding, fail, ok, warn
from bus_cli.main import version
from bus_cli.ros2.script import is_ours, programs

__all__ = ["examine", "native_core", "ros2_program", "shared_memory"]

_MIN_PYTHON = (3, 11)


def ros2_program(path: Sequence[str]) -> Iterator[Finding]:
    """A finding about busd's `ros2` if it is in a folder of `path`: it must not hide another one."""
    found = [(one, is_ours(one)) for one in programs(path)]
    ours = next((one for one, is_own in found if is_own), None)
    other = next((one for one, is_own in found if not is_own), None)
    if ours is not None and other is None:
        yield ok("ros2", f"{ours} runs bus")
    elif ours is not None:
        text = f"{found[0][0]} comes before the others in PATH: {ours} is busd's, {other} is not"
        yield warn("ros2", text, f"bus ros2 uninstall --into {ours.parent}")


def examine() -> Iterator[Finding]:
    """Findings about Python and the relevant packages."""
    import msgspec

    python = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info >= _MIN_PYTHON:
        yield ok("python", f"{python} ({sys.executable})")
    else:
        yield fail("python", python, "busd needs Python 3.11 or later")
    yield ok("busd", version("busd") or "run from its sources, not installed")
    yield ok("msgspec", msgspec.__version__)
    uvloop = version("uvloop")
    if uvloop is None:
        yield warn("uvloop", "not there; asyncio's own loop is slower", "pip install uvloop")
    else:
        yield ok("uvloop", uvloop)


def shared_memory() -> Finding:
    """Whether messages can use shared memory, and if not, the reason."""
    from bus import shm

    reason, advice = shm.why_not(), shm.advice()
    if not reason:
        from bus.shm import segments

        try:
            segments.make_doorbell().close()
            segments.make_readers(1)[0].close()
        except OSError as error:
            reason = f"the system refuses it ({error.strerror})"
    if reason:
        return warn("shared memory", f"not used: {reason}; messages go through busd", advice)
    return ok("shared memory", "used between processes of one user")


def native_core(folder: Path | None = None) -> Iterator[Finding]:
    """Whether the core is older than its sources, if they are there. `folder` replaces the core's folder."""
    from bus import shm

    folder = folder or Path(shm.__file__).parent
    built = [core.stat().st_mtime for core in folder.glob("_core*.so")]
    newer = sorted(
        source.name for source in folder.glob("*.c") if built and source.stat().st_mtime > max(built)
    )
    if newer:
        text = f"built before {', '.join(newer[:3])} changed"
        yield warn("native core", text, "BUS_NATIVE=yes pip install --editable . (in the source tree)")
