"""The release of the packages: file names, metadata and the changelog name the same one."""

import re
import tarfile
from email import message_from_bytes
from email.message import Message
from pathlib import Path
from zipfile import ZipFile

from bus.base.version import RELEASE
from wheels import Wrong
from wheels.sources import ROOT

__all__ = ["check_versions"]


def check_versions(packages: list[Path], changelog: Path = ROOT / "CHANGELOG.md") -> None:
    """Raises Wrong if a package or the newest heading of the changelog names another release than RELEASE."""
    for package in packages:
        if not re.match(rf"busd-{re.escape(RELEASE)}(-|\.tar\.gz$)", package.name):
            raise Wrong(f"{package.name} is not named busd-{RELEASE}")
        metadata = _metadata(package)
        if (found := f"{metadata['Name']} {metadata['Version']}") != f"busd {RELEASE}":
            raise Wrong(f"{package.name} says in its metadata that it is {found}, not busd {RELEASE}")
    headings = re.findall(r"^## (\S+) - ", changelog.read_text(), re.MULTILINE)
    if headings[:1] != [RELEASE]:
        raise Wrong(
            f"{changelog.name} begins with {', '.join(headings[:1]) or 'no release'}, not with {RELEASE}"
        )


def _metadata(package: Path) -> Message:
    """Of a wheel or an sdist."""
    if package.suffix == ".whl":
        with ZipFile(package) as wheel:
            return message_from_bytes(wheel.read(f"busd-{RELEASE}.dist-info/METADATA"))
    with tarfile.open(package) as sdist:
        member = sdist.extractfile(f"busd-{RELEASE}/PKG-INFO")
        assert member is not None
        return message_from_bytes(member.read())
