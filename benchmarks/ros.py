"""ROS 2's own rclpy, in a separate virtual environment (`make peers`): finds it, and has its settings.

It also measures the size of the installation, of ROS 2 and of busd.
"""

import re
from collections.abc import Iterable, Mapping
from importlib.metadata import Distribution, distributions, requires
from pathlib import Path
from zlib import crc32

from benchmarks.machine import ROOT, ROS_VENV

PYTHON = ROS_VENV / "bin" / "python"
PACKAGES = ("ros-jazzy-rclpy", "ros-jazzy-std-msgs", "ros-jazzy-sensor-msgs", "ros-jazzy-rmw-fastrtps-cpp")
"""The packages that users install; their dependencies are installed with them."""
_DOMAINS = 100
_LARGE_SEGMENT = """<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<transport_descriptors><transport_descriptor>
<transport_id>shm</transport_id><type>SHM</type>
<segment_size>67108864</segment_size><maxMessageSize>16777216</maxMessageSize>
</transport_descriptor></transport_descriptors>
<participant profile_name="bench" is_default_profile="true"><rtps>
<userTransports><transport_id>shm</transport_id></userTransports>
<useBuiltinTransports>false</useBuiltinTransports>
</rtps></participant></profiles>
"""
"""Without this setting, Fast DDS moves long messages in pieces of 64 KiB through half a MiB."""
_LARGE_BUFFERS = """<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
<transport_descriptors><transport_descriptor>
<transport_id>udp</transport_id><type>UDPv4</type><receiveBufferSize>4194304</receiveBufferSize>
</transport_descriptor><transport_descriptor>
<transport_id>shm</transport_id><type>SHM</type>
</transport_descriptor></transport_descriptors>
<participant profile_name="bench" is_default_profile="true"><rtps>
<userTransports><transport_id>udp</transport_id><transport_id>shm</transport_id></userTransports>
<useBuiltinTransports>false</useBuiltinTransports>
</rtps></participant></profiles>
"""
"""Without this setting, the kernel drops parts of an image that come faster than Fast DDS reads them
(docs/bridge.md advises it)."""
_NAME = re.compile(r"[A-Za-z0-9._-]+")


def missing() -> str:
    """The reason why it can't be measured here; empty if it can."""
    return "" if version() else "it is not installed here: make peers, which needs x86_64"


def version() -> str:
    """The version of the package rclpy; empty if it is missing."""
    found = _installed(_site()).get("ros-rclpy")
    return found.version if found and PYTHON.exists() else ""


def environ(folder: Path) -> dict[str, str]:
    """A separate domain for the run in `folder`, on this machine only, without files elsewhere."""
    return {
        "ROS_DOMAIN_ID": str(1 + crc32(folder.name.encode()) % _DOMAINS),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    }


def with_large_segment(folder: Path) -> dict[str, str]:
    """The setting for a large segment of shared memory in Fast DDS, so each message of some MiB is one
    piece."""
    return _with_profile(folder, _LARGE_SEGMENT)


def with_large_buffers(folder: Path) -> dict[str, str]:
    """The setting for large buffers of its sockets in Fast DDS, for messages from other machines."""
    return _with_profile(folder, _LARGE_BUFFERS)


def _with_profile(folder: Path, text: str) -> dict[str, str]:
    profile = folder / "fastdds.xml"
    profile.write_text(text)
    return {"FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)}


def installed() -> dict[str, float]:
    """The size of an installation of PACKAGES."""
    return _size_of(PACKAGES, _site())


def busd_installed() -> dict[str, float]:
    """The size of an installation of busd: its packages in this tree, and all their dependencies."""
    found = _size_of(one for one in requires("busd") or () if "extra ==" not in one)
    ours = (path for name in ("clients/bus", "busd") for path in (ROOT / name).rglob("*") if path.is_file())
    found["mib"] += sum(path.stat().st_size for path in ours if path.suffix != ".pyc") / (1 << 20)
    found["packages"] += 1
    return found


def _size_of(names: Iterable[str], site: Iterable[str] | None = None) -> dict[str, float]:
    """MiB of packages with all dependencies, without compiled Python files, and their number.

    Searches the folders `site`, or the folders of this Python.
    """
    have = _installed(site)
    wanted, found = [_key(name) for name in names], set[str]()
    while wanted:
        key = wanted.pop()
        if key in have and key not in found:
            found.add(key)
            wanted += [_key(one) for one in have[key].requires or () if "extra ==" not in one]
    total = sum(_bytes_of(have[key]) for key in found)
    return {"mib": total / (1 << 20), "packages": float(len(found))}


def _site() -> list[str]:
    return [str(path) for path in ROS_VENV.glob("lib/python*/site-packages")]


def _installed(site: Iterable[str] | None) -> Mapping[str, Distribution]:
    found = distributions() if site is None else distributions(path=list(site))
    return {_key(one.name): one for one in found}


def _key(requirement: str) -> str:
    """The name at the beginning of a requirement, in a form for comparisons."""
    match = _NAME.match(requirement.strip())
    return re.sub(r"[-_.]+", "-", match.group()).lower() if match else ""


def _bytes_of(package: Distribution) -> int:
    paths = (Path(str(package.locate_file(one))) for one in package.files or () if one.suffix != ".pyc")
    return sum(path.stat().st_size for path in paths if path.exists())
