"""Files of packages: addresses, hostile paths, limits, and the turns of one client."""

import asyncio
import os
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus_web.foxglove import assets
from bus_web.foxglove.assets import AssetError, Assets, parse_uri, read_asset
from bus_web.foxglove.protocol import FetchAsset
from rows import for_each
from semantics import until
from web_world import WebWorld, turns


@pytest.fixture
def share(tmp_path: Path) -> Iterator[Path]:
    """A share folder with a mesh, and a secret beside it."""
    share = tmp_path / "share" / "robot"
    (share / "meshes").mkdir(parents=True)
    (share / "meshes" / "arm 1.dae").write_bytes(b"mesh")
    (tmp_path / "share" / "secret.dae").write_bytes(b"secret")
    yield share


@for_each(
    ("uri", "found"),
    [
        ("package://robot/meshes/arm.dae", ("robot", ["meshes", "arm.dae"])),
        ("package://robot/arm%201.STL", ("robot", ["arm 1.STL"])),
        ("package://robot/%C3%A4.png", ("robot", ["ä.png"])),
        ("package://robot/a..b/c.x.urdf", ("robot", ["a..b", "c.x.urdf"])),
    ],
)
def test_addresses(uri: str, found: tuple[str, list[str]]) -> None:
    assert parse_uri(uri) == found


@for_each(
    ("uri", "text"),
    [
        ("", "only files of packages"),
        ("file:///etc/passwd", "only files of packages"),
        ("http://localhost/mesh.dae", "only files of packages"),
        ("/etc/passwd", "only files of packages"),
        ("PACKAGE://robot/mesh.dae", "only files of packages"),
        ("package://", "is not the name of a package"),
        ("package:///etc/mesh.dae", "is not the name of a package"),
        ("package://../robot/mesh.dae", "is not the name of a package"),
        ("package://%2e%2e/mesh.dae", "is not the name of a package"),
        ("package://robot%2f..%2f../mesh.dae", "is not the name of a package"),
        ("package://robot\n/mesh.dae", "is not the name of a package"),
        ("package://robot", "is no mesh"),
        ("package://robot/", "a part that is empty"),
        ("package://robot//mesh.dae", "a part that is empty"),
        ("package://robot/../mesh.dae", "begins with a dot"),
        ("package://robot/./mesh.dae", "begins with a dot"),
        ("package://robot/meshes/../../../mesh.dae", "begins with a dot"),
        ("package://robot/%2e%2e/mesh.dae", "begins with a dot"),
        ("package://robot/..%2f..%2fmesh.dae", "begins with a dot"),
        ("package://robot/a%2fmesh.dae", "has a slash"),
        ("package://robot/.git/mesh.dae", "begins with a dot"),
        ("package://robot/.dae", "begins with a dot"),
        ("package://robot/mesh%00.dae", "has a slash"),
        ("package://robot/mesh.dae%00", "has a slash"),
        ("package://robot/%ff.dae", "no UTF-8"),
        ("package://robot/package.xml", "is no mesh"),
        ("package://robot/key.pem", "is no mesh"),
        ("package://robot/mesh.dae?x", "is no mesh"),
        ("package://robot/dae", "is no mesh"),
        (f"package://robot/{'x' * 1000}.dae", "1000 characters at most"),
    ],
)
def test_hostile_addresses(uri: str, text: str) -> None:
    with pytest.raises(AssetError) as caught:
        parse_uri(uri)
    assert text in str(caught.value)


def test_a_file_is_read(share: Path) -> None:
    assert read_asset(share, ["meshes", "arm 1.dae"]) == b"mesh"


def test_no_path_leads_out(share: Path) -> None:
    outside = share.parent
    (share / "link.dae").symlink_to(outside / "secret.dae")
    (share / "inside.dae").symlink_to("meshes/arm 1.dae")
    (share / "out").symlink_to(outside)
    (share / "here").symlink_to("meshes")
    os.mkfifo(share / "pipe.dae")
    (share / "folder.dae").mkdir()
    for parts, text in (
        (["link.dae"], "links are not followed"),
        (["inside.dae"], "links are not followed"),
        (["out", "secret.dae"], "a link is on the way"),
        (["here", "arm 1.dae"], "a link is on the way"),
        (["pipe.dae"], "is no file"),
        (["folder.dae"], "is no file"),
        (["none.dae"], "has no file"),
        (["meshes", "arm 1.dae", "x.dae"], "has no file"),
        (["x" * 300 + ".dae"], "File name too long"),
    ):
        with pytest.raises(AssetError) as caught:
            read_asset(share, parts)
        assert text in str(caught.value) and str(outside) not in str(caught.value)
    descriptors = Path("/proc/self/fd")
    before = len([*descriptors.iterdir()])
    with pytest.raises(AssetError):
        read_asset(share, ["link.dae"])
    assert len([*descriptors.iterdir()]) == before


def test_a_large_file_is_not_read(share: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (share / "large.stl").open("wb") as file:
        file.truncate(assets.MOST_BYTES + 1)
    with pytest.raises(AssetError, match="has 33554433 bytes; the limit is 33554432"):
        read_asset(share, ["large.stl"])
    monkeypatch.setattr(assets, "MOST_BYTES", 4)
    assert read_asset(share, ["meshes", "arm 1.dae"]) == b"mesh"


async def test_the_client_gets_files_and_reasons(share: Path) -> None:
    world = WebWorld()

    def share_of(package: str) -> Path:
        if package != "robot":
            raise AssetError("there is no such package")
        return share

    served = Assets(world.client, share_of)
    for number, uri in enumerate(
        ("package://robot/meshes/arm%201.dae", "package://robot/../secret.dae", "package://other/a.dae")
    ):
        fetching = asyncio.create_task(served.fetch(FetchAsset(uri, number)))
        await until(lambda number=number: world.client.notices or len(world.socket.sent) > number)
        await world.told()
        await fetching
    good, hostile, unknown = world.socket.sent
    assert good == b"\x04" + struct.pack("<IBI", 0, 0, 0) + b"mesh"
    assert struct.unpack_from("<BIB", hostile) == (4, 1, 1) and b"begins with a dot" in hostile
    assert struct.unpack_from("<BIB", unknown) == (4, 2, 1) and unknown.endswith(b"there is no such package")
    await world.close()


async def test_a_client_that_does_not_read_holds_one_file(share: Path) -> None:
    world = WebWorld()
    served = Assets(world.client, lambda package: share)
    said = [FetchAsset("package://robot/meshes/arm%201.dae", number) for number in range(5)]
    fetching = [asyncio.create_task(served.fetch(one)) for one in said]
    await until(lambda: world.client.notices)
    await turns()
    assert world.client.notices == 1
    await world.told()  # it reads now
    await asyncio.gather(*fetching)
    assert [struct.unpack_from("<BI", one)[1] for one in world.socket.sent] == [*range(5)]
    await world.close()


async def test_a_package_that_comes_with_busd_is_found() -> None:
    world = WebWorld()
    fetching = asyncio.create_task(Assets(world.client).fetch(FetchAsset("package://std_msgs/none.dae", 1)))
    await until(lambda: world.client.notices)
    await world.told()
    await fetching
    assert b"the package has no file 'none.dae'" in world.socket.sent[-1]
    await world.close()
