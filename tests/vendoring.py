"""`make vendor`: libraries of `bus web` and of the pages' site, as npm has them, with licences and hashes.

`make axe` fetches the library with which tests find accessibility faults, `make foxglove` the client that
Foxglove has published; they are not part of the page.
"""

import json
import subprocess
import sys
import tarfile
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]

PACKAGES = {
    ROOT / "clients" / "bus_web" / "page" / "vendor": {
        "@dagrejs/dagre@3.1.3": {"dist/dagre.min.js": "dagre.min.js", "LICENSE": "dagre.LICENSE.txt"},
        "uplot@1.6.32": {
            "dist/uPlot.iife.min.js": "uplot.min.js",
            "dist/uPlot.min.css": "uplot.min.css",
            "LICENSE": "uplot.LICENSE.txt",
        },
    },
    ROOT / "docs" / "assets" / "vendor": {
        "iframe-worker@1.0.4": {"shim/index.js": "iframe-worker.js", "LICENSE": "iframe-worker.LICENSE.txt"},
    },
}
"""By folder. For newer ones, write their versions here."""

AXE = ROOT / ".venv" / "axe.min.js"
_AXE = "axe-core@4.14.1", "29348999450cdf2849a8e70b7912fc2da85a849da39c0d0d5394f51d4a9ed95c"

FOXGLOVE = ROOT / ".venv" / "foxglove"
_FOXGLOVE = "@foxglove/ws-protocol@0.8.0", "ws@8.18.0"


def main() -> int:
    if sys.argv[1:] == ["axe"]:
        return fetch_axe()
    if sys.argv[1:] == ["foxglove"]:
        return fetch_foxglove()
    for folder, packages in PACKAGES.items():
        fetch_libraries(folder, packages)
    return 0


def fetch_libraries(vendor: Path, packages: dict[str, dict[str, str]]) -> None:
    lines = ["# sha256, file, package of npm, file in it. Written by `make vendor`."]
    with TemporaryDirectory() as folder:
        for package, files in packages.items():
            archive = _fetch(package, Path(folder))
            for inside, name in files.items():
                data = _member(archive, f"package/{inside}")
                (vendor / name).write_bytes(data)
                lines.append(f"{sha256(data).hexdigest()}  {name}  {package}  {inside}")
    (vendor / "versions.txt").write_text("\n".join(lines) + "\n")


def fetch_axe() -> int:
    package, digest = _AXE
    with TemporaryDirectory() as folder:
        data = _member(_fetch(package, Path(folder)), "package/axe.min.js")
    if sha256(data).hexdigest() != digest:
        print(f"{package} is not what it was: {sha256(data).hexdigest()}", file=sys.stderr)
        return 1
    AXE.write_bytes(data)
    return 0


def fetch_foxglove() -> int:
    FOXGLOVE.mkdir(exist_ok=True)
    quiet = ("--ignore-scripts", "--no-audit", "--no-fund", "--no-save", "--silent")
    command = ["npm", "install", "--prefix", str(FOXGLOVE), *quiet, *_FOXGLOVE]
    return subprocess.run(command, check=False).returncode


def _fetch(package: str, folder: Path) -> Path:
    command = ["npm", "pack", "--json", "--silent", "--pack-destination", str(folder), package]
    told = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    packed = json.loads(told)
    one = packed[0] if isinstance(packed, list) else next(iter(packed.values()))
    return folder / Path(one["filename"].replace("@", "").replace("/", "-"))


def _member(archive: Path, name: str) -> bytes:
    with tarfile.open(archive) as files:
        found = files.extractfile(name)
        assert found is not None, name
        return found.read()


if __name__ == "__main__":
    sys.exit(main())
