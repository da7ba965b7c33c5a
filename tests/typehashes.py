"""Prints lines for tests/unit/bus/share/type_hashes.txt: hashes of types, computed by ROS 2's own tools.

    make peers
    .venv-jazzy/bin/python tests/typehashes.py FOLDER ...

Each FOLDER is a package's folder in a clone of its sources, with `msg`, `srv` or `action` in it; its name is
the package's name. Types of other packages that it needs come from clients/bus/share.
"""

import io
import json
import re
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

SHARE = Path(__file__).parents[1] / "clients" / "bus" / "share"
KINDS = ("msg", "srv", "action")
DIGITS = 16
PARTS = {"msg": ("",), "srv": ("",), "action": ("_Goal", "_Result", "_Feedback")}
ALWAYS = {
    "msg": (),
    "srv": ("service_msgs", "builtin_interfaces"),
    "action": ("service_msgs", "builtin_interfaces", "unique_identifier_msgs", "action_msgs"),
}
"""Packages that ROS 2 adds to each definition of a kind."""
OTHER = re.compile(r"^\s*([a-z]\w*)/(?:msg/)?[A-Z]", re.MULTILINE)


def definitions(package: Path) -> list[Path]:
    return [path for kind in KINDS for path in sorted((package / kind).glob(f"*.{kind}"))]


def needed(package: Path) -> set[str]:
    """The names of other packages whose types a package needs."""
    found: set[str] = set()
    for path in definitions(package):
        found.update(OTHER.findall(path.read_text()), ALWAYS[path.suffix[1:]])
    return found - {package.name}


def in_order(given: dict[str, Path]) -> list[Path]:
    """The packages, each one behind those that it needs."""
    found: list[Path] = []

    def add(name: str) -> None:
        package = given.get(name, SHARE / name)
        if package not in found:
            for other in sorted(needed(package)):
                add(other)
            found.append(package)

    for name in given:
        add(name)
    return found


def describe(package: Path, out: Path, described: list[str]) -> None:
    """Write the descriptions of a package's types, with their hashes, into a folder below `out`."""
    adapter = import_module("rosidl_adapter")
    generator = import_module("rosidl_generator_type_description")
    here = out / package.name
    for path in definitions(package):
        adapter.convert_to_idl(package, package.name, path.relative_to(package), here)
    arguments = {
        "package_name": package.name,
        "output_dir": str(here),
        "idl_tuples": [f"{here}:{path.parent.name}/{path.stem}.idl" for path in definitions(package)],
        "include_paths": [f"{name}:{out / name}" for name in described],
    }
    file = out / f"{package.name}.json"
    file.write_text(json.dumps(arguments))
    generator.generate_type_hash(str(file))


def lines(package: Path, out: Path) -> Iterator[str]:
    for path in definitions(package):
        kind = path.parent.name
        text = (out / package.name / kind / f"{path.stem}.json").read_text()
        hashes = {one["type_name"]: one["hash_string"] for one in json.loads(text)["type_hashes"]}
        for part in PARTS[kind]:
            name = f"{package.name}/{kind}/{path.stem}{part}"
            yield f"{name} {hashes[name].removeprefix('RIHS01_')[:DIGITS]}"


def main(folders: list[str]) -> None:
    given = {path.name: path for path in (Path(folder).resolve() for folder in folders)}
    with TemporaryDirectory() as folder:
        described: list[str] = []
        for package in in_order(given):
            with redirect_stdout(io.StringIO()):  # a line for each file
                describe(package, Path(folder), described)
            described.append(package.name)
        for package in given.values():
            print(*lines(package, Path(folder)), sep="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
