"""Files of packages for a client: the URDF and the meshes that a robot's description names.

A client names a file as `package://PACKAGE/PATH`. Only files below the package's share folder are served, and
only kinds of files that viewers show. Each folder on the way is opened without following links, so no path
leads out, whatever is renamed meanwhile.
"""

import asyncio
import errno
import os
import re
import stat
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote_to_bytes

from bus_ros.ament_index_python.packages import PackageNotFoundError, get_package_share_path
from bus_web.foxglove import protocol
from bus_web.foxglove.client import Client

__all__ = ["MOST_BYTES", "AssetError", "Assets", "parse_uri", "read_asset"]

MOST_BYTES = 32 << 20
"""Limit of a file."""
_MOST_URI = 1000
_SCHEME = "package://"
_KINDS = frozenset(
    f".{suffix}"
    for suffix in (
        *("dae", "fbx", "glb", "gltf", "mtl", "obj", "stl"),
        *("jpeg", "jpg", "png", "tif", "tiff", "webp"),
        *("urdf", "xacro"),
    )
)
"""The kinds that ROS 2's bridge to Foxglove serves."""
_PACKAGE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]+")


class AssetError(Exception):
    """The file is not served; the text says why, without a path of this machine."""


class Asset(NamedTuple):
    """A file of a package."""

    package: str
    parts: Sequence[str]
    """The names of the folders below the share folder, and of the file."""


class Assets:
    """Answers the requests of one client, one after the other: it has at most one file in memory."""

    def __init__(self, client: Client, share_of: Callable[[str], Path] | None = None) -> None:
        self._client = client
        self._share_of = share_of or _share_of
        self._turn = asyncio.Lock()

    async def fetch(self, said: protocol.FetchAsset) -> None:
        """Send the file, or why it is not served."""
        async with self._turn:
            try:
                asset = parse_uri(said.uri)
                data = await asyncio.to_thread(self._read, asset)
            except AssetError as error:
                self._client.notify(protocol.asset_missing(said.request_id, str(error)))
                return
            self._client.notify(protocol.asset(said.request_id, data))
            del data
            await self._client.drain()

    def _read(self, asset: Asset) -> bytes:
        return read_asset(self._share_of(asset.package), asset.parts)


def parse_uri(uri: str) -> Asset:
    """Read an address of a file. Raises AssetError."""
    if len(uri) > _MOST_URI:
        raise AssetError(f"an address has {_MOST_URI} characters at most; this one has {len(uri)}")
    if not uri.startswith(_SCHEME):
        raise AssetError(f"only files of packages are served here (package://PACKAGE/PATH), not {uri!r:.200}")
    package, *parts = [_decoded(part, uri) for part in uri.removeprefix(_SCHEME).split("/")]
    if not _PACKAGE.fullmatch(package):
        raise AssetError(f"{package!r:.200} is not the name of a package")
    for part in parts:
        if not part or part.startswith(".") or "/" in part or "\0" in part:
            raise AssetError(f"{uri!r:.200} has a part that is empty, begins with a dot or has a slash")
    if not parts or Path(parts[-1]).suffix.lower() not in _KINDS:
        raise AssetError(f"{uri!r:.200} is no mesh, picture or description of a robot")
    return Asset(package, parts)


def _decoded(part: str, uri: str) -> str:
    try:
        return unquote_to_bytes(part).decode()
    except UnicodeError:
        raise AssetError(f"{uri!r:.200} is no UTF-8") from None


def read_asset(share: Path, parts: Sequence[str]) -> bytes:
    """Read the file below `share`. Raises AssetError if it is not there, no plain file, or too large."""
    name = "/".join(parts)
    with ExitStack() as stack:

        def opened(path: str | Path, flags: int, folder: int | None = None) -> int:
            found = os.open(path, flags | os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK, dir_fd=folder)
            stack.callback(os.close, found)
            return found

        try:
            at = opened(share, os.O_DIRECTORY)
            for part in parts[:-1]:
                at = opened(part, os.O_DIRECTORY | os.O_NOFOLLOW, at)
            at = opened(parts[-1], os.O_NOFOLLOW, at)
            about = os.fstat(at)
            if not stat.S_ISREG(about.st_mode):
                raise AssetError(f"{name!r:.200} is no file")
            if about.st_size > MOST_BYTES:
                raise AssetError(f"{name!r:.200} has {about.st_size} bytes; the limit is {MOST_BYTES}")
            return _bounded(at)
        except (FileNotFoundError, NotADirectoryError):
            raise AssetError(
                f"the package has no file {name!r:.200}, or a link is on the way to it"
            ) from None
        except OSError as error:
            why = "links are not followed" if error.errno == errno.ELOOP else error.strerror
            raise AssetError(f"{name!r:.200} can't be read: {why}") from None


def _bounded(descriptor: int) -> bytes:
    """The contents up to the limit, also of a file that grows meanwhile."""
    with open(descriptor, "rb", closefd=False) as file:
        return file.read(MOST_BYTES)


def _share_of(package: str) -> Path:
    try:
        return get_package_share_path(package, print_warning=False)
    except (PackageNotFoundError, ValueError):
        raise AssetError(f"there is no package {package!r:.200} here") from None
