"""Finds packages and their programs: ament and colcon prefixes, and installed distributions.

Reads only file names and small text files: a search takes a few milliseconds. Must not know the start of a
program, or the output of a tool.
"""

import os
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

__all__ = [
    "INDEX",
    "Executable",
    "Prefix",
    "built_in",
    "editable_folder",
    "executables",
    "find_prefix",
    "manifest",
    "names",
    "nearest",
    "prefixes",
    "python_folders",
    "source_folder",
    "source_programs",
]

INDEX = Path("share", "ament_index", "resource_index", "packages")
"""A path relative to a prefix: it has a file for each package."""

_CONTAINERS = {
    "component_container": "bus_ros.rclpy_components.component_container:main",
    "component_container_isolated": "bus_ros.rclpy_components.component_container:main_mt",
    "component_container_mt": "bus_ros.rclpy_components.component_container:main_mt",
}

_BUILT_IN = {
    "joint_state_publisher": {"joint_state_publisher": "bus_tf2.programs.joint_state_publisher:main"},
    "rclcpp_components": _CONTAINERS,
    "rclpy_components": _CONTAINERS,
    "robot_state_publisher": {"robot_state_publisher": "bus_tf2.programs.robot_state_publisher:main"},
    "tf2_ros": {
        "buffer_server": "bus_tf2.programs.buffer_server:main",
        "static_transform_publisher": "bus_tf2.programs.static_transform_publisher:main",
        "tf2_echo": "bus_tf2.programs.tf2_echo:main",
        "tf2_monitor": "bus_tf2.programs.tf2_monitor:main",
    },
    "tf2_tools": {"view_frames": "bus_tf2.programs.view_frames:main"},
    "turtle_tf2_py": {
        name: f"bus_tf2.turtle_tf2_py.{name}:main"
        for name in (
            *("dynamic_frame_tf2_broadcaster", "fixed_frame_tf2_broadcaster"),
            *("static_turtle_tf2_broadcaster", "turtle_tf2_broadcaster", "turtle_tf2_listener"),
            "turtle_tf2_message_broadcaster",
        )
    },
    "turtlesim": {
        name: f"bus_turtlesim.{name}:main"
        for name in ("draw_square", "mimic", "turtle_teleop_key", "turtlesim_node")
    },
}
"""Programs that come with busd, used if no installed package has them: entry points, by package and name."""

_DEPEND = re.compile(r"<(?:depend|exec_depend|run_depend)\b[^>]*>\s*([\w-]+)\s*</")
_NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_.-]*[A-Za-z0-9])?")
_COLCON = (".colcon_install_layout", "local_setup.sh", "setup.sh")


class Prefix(NamedTuple):
    """A folder under which packages are installed."""

    path: Path
    is_sourced: bool = True
    """False: a workspace that was built, but its set-up was not sourced; programs need its paths added."""
    is_ours: bool = False
    """It is the prefix of this Python, where many folders are not packages."""


class Executable(NamedTuple):
    """A program of a package."""

    package: str
    name: str
    path: str
    prefix: Prefix
    entry_point: str | None = None
    """`module:function` of a console script; None: the file at `path` is the program."""
    python_folders: tuple[str, ...] = ()
    """If the program runs from its source: the folders from which its package's modules are imported."""


def prefixes() -> list[Prefix]:
    """Possible prefixes: $AMENT_PREFIX_PATH, the workspace around the current folder, this Python."""
    sourced = map(Path, filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)))
    found = {_real(path): Prefix(path) for path in sourced}
    for path in _workspace_prefixes():
        found.setdefault(_real(path), Prefix(path, is_sourced=False))
    ours = Path(sys.prefix)
    found.setdefault(ours.resolve(), Prefix(ours, is_ours=True))
    return list(found.values())


def _real(path: Path) -> Path:
    """The path without links; unchanged if the links form a circle."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        return path


def find_prefix(package: str) -> Prefix | None:
    """The prefix under which a package, or the distribution of that name, is installed."""
    if _NAME.fullmatch(package) is None:
        return None
    metadata = None
    prefix = next((one for one in prefixes() if _has_package(one, package)), None)
    if prefix is None:
        metadata = _metadata_of(package)
    return _prefix_of_metadata(metadata) if metadata else prefix


def executables(package: str) -> list[Executable] | None:
    """The programs of a package, sorted by name; None if there is no such package.

    They are the programs in `lib/PACKAGE` of the first prefix that has the package, and the console scripts
    of the distribution with its name. If folders below `lib/PACKAGE` have programs of the same name, all are
    returned. If there is no such package, the programs that come with busd under its name are returned.
    """
    prefix = find_prefix(package)
    if prefix is None:
        return _built_in(package)
    found = [] if prefix.is_ours and not _has_package(prefix, package) else list(_files(package, prefix))
    present = {one.name for one in found}
    metadata = _metadata_of(package)
    if metadata is not None:
        found += [one for one in _console_scripts(package, metadata) if one.name not in present]
    return sorted(found, key=lambda one: (one.name, one.path))


def built_in() -> list[str]:
    """The packages with programs that come with busd."""
    return list(_BUILT_IN)


def _built_in(package: str) -> list[Executable] | None:
    targets = _BUILT_IN.get(package)
    if targets is None:
        return None
    ours = Prefix(Path(sys.prefix), is_ours=True)
    folder = ours.path / "lib" / package
    return [
        Executable(package, name, str(folder / name), ours, target)
        for name, target in sorted(targets.items())
    ]


def manifest(package: str) -> Path | None:
    """The package.xml of a package; None if it has none."""
    prefix = find_prefix(package)
    if prefix is None:
        return None
    path = prefix.path / "share" / package / "package.xml"
    if path.is_file():
        return path
    folder = editable_folder(package)
    return None if folder is None else folder / "package.xml"


def editable_folder(package: str) -> Path | None:
    """The folder of the package.xml of a distribution that was installed by pip install -e, or None."""
    metadata = _metadata_of(package)
    return _editable_folder(metadata) if metadata else None


def names() -> list[str]:
    """All packages that an ament index knows, or that have a package.xml, sorted."""
    found = {stem for stem, metadata in _distributions() if _editable_folder(metadata)}
    for prefix in prefixes():
        found.update(path.name for path in _listed(prefix.path / INDEX))
        found.update(path.parent.name for path in prefix.path.glob("share/*/package.xml"))
    return sorted(found)


def nearest(name: str) -> str | None:
    """The package or distribution with the most similar name."""
    from bus.base import suggest

    return suggest.nearest(name, [*names(), *_BUILT_IN, *(stem for stem, _ in _distributions())])


def source_folder(package: str) -> Path | None:
    """The source folder of a package beside, below or around the current folder; it need not be built."""
    if _NAME.fullmatch(package) is None:
        return None
    here = Path.cwd()
    around = (folder for folder in (here, *here.parents) if folder.name == package)
    beside = (
        path
        for folder in (here, here.parent)
        for pattern in (package, f"src/{package}", f"*/{package}", f"src/*/{package}")
        for path in sorted(folder.glob(pattern))
    )
    return next((path for path in (*around, *beside) if (path / "package.xml").is_file()), None)


def source_programs(folder: Path) -> tuple[list[Executable], set[str]] | None:
    """The Python programs of a CMake package, to run from source, and the names of programs to be compiled.

    The programs can import the modules of the package. They can also import modules of packages that it
    depends on, if these are in source form, too. Returns None if it is no such package.
    """
    from bus_ros import cmakelists  # late: few packages need it

    found = cmakelists.read(folder, folder.name)
    if found is None:
        return None
    prefix = Prefix(folder, is_sourced=False)
    modules = *found.python_folders, *_python_of_dependencies(folder)
    programs = [
        Executable(folder.name, name, str(path), prefix, python_folders=modules)
        for name, path in sorted(found.programs.items())
    ]
    return programs, found.compiled


def python_folders(prefix: Prefix) -> list[str]:
    """The folders with Python packages under a prefix, for this version of Python.

    Includes the targets of links that `colcon build --symlink-install` has made there.
    """
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    sites = [
        site
        for lib in ("lib", "local/lib")
        for last in ("site-packages", "dist-packages")
        if (site := prefix.path / lib / version / last).is_dir()
    ]
    links = [link for site in sites for link in sorted(site.glob("*.egg-link"))]
    return [*map(str, sites), *(link.read_text("utf-8").partition("\n")[0].strip() for link in links)]


def _python_of_dependencies(folder: Path) -> Iterator[str]:
    """The folders of Python modules of all packages that a package depends on and that are not installed."""
    from bus_ros import cmakelists

    known = {folder.name}
    unread = [folder]
    while unread:
        manifest = (unread.pop() / "package.xml").read_text("utf-8", "replace")
        for name in _DEPEND.findall(manifest):
            if name in known:
                continue
            known.add(name)
            source = source_folder(name)
            if source is None or find_prefix(name) is not None:
                continue
            unread.append(source)
            if (source / "setup.py").is_file():
                yield str(source)
            elif (found := cmakelists.read(source, name)) is not None:
                yield from found.python_folders


def _workspace_prefixes() -> list[Path]:
    """The nearest `install` folder upwards that colcon made, and the prefix of each isolated package."""
    here = Path.cwd()
    for folder in (here, *here.parents):
        install = folder / "install"
        if any((install / name).is_file() for name in _COLCON):
            isolated = [
                path
                for path in _listed(install)
                if (path / "share" / path.name).is_dir() or (path / "lib" / path.name).is_dir()
            ]
            return [install, *isolated]
    return []


def _has_package(prefix: Prefix, package: str) -> bool:
    if (prefix.path / INDEX / package).is_file():
        return True
    if (prefix.path / "share" / package / "package.xml").is_file():
        return True
    return not prefix.is_ours and (prefix.path / "lib" / package).is_dir()


def _files(package: str, prefix: Prefix) -> Iterator[Executable]:
    for folder, below, files in os.walk(prefix.path / "lib" / package):
        below[:] = [name for name in below if not name.startswith(".")]
        for name in files:
            path = f"{folder}/{name}"
            if os.access(path, os.X_OK):
                yield Executable(package, name, path, prefix)


def _console_scripts(package: str, metadata: Path) -> Iterator[Executable]:
    prefix = _prefix_of_metadata(metadata)
    try:
        lines = (metadata / "entry_points.txt").read_text("utf-8").splitlines()
    except OSError:
        return  # the distribution has no entry points
    section = ""
    for line in map(str.strip, lines):
        if line.startswith("["):
            section = line
        elif section == "[console_scripts]" and "=" in line and not line.startswith(("#", ";")):
            name, _, target = map(str.strip, line.partition("="))
            path = str(prefix.path / "bin" / name)
            yield Executable(package, name, path, prefix, target.partition("[")[0].strip())


def _prefix_of_metadata(metadata: Path) -> Prefix:
    site = metadata.parent
    if site.name in ("site-packages", "dist-packages") and len(site.parents) > 2:
        path = site.parents[2]
        return Prefix(path, is_ours=path == Path(sys.prefix))
    return Prefix(Path(sys.prefix), is_ours=True)


def _metadata_of(distribution: str) -> Path | None:
    wanted = _normal(distribution)
    return next((path for stem, path in _distributions() if _normal(stem) == wanted), None)


def _distributions() -> tuple[tuple[str, Path], ...]:
    """Names, as in folder names, and metadata folders of all distributions that this Python can import."""
    return _distributions_in(tuple(sys.path))


@cache
def _distributions_in(folders: tuple[str, ...]) -> tuple[tuple[str, Path], ...]:
    found = [path for folder in folders for path in _listed(Path(folder))]
    return tuple(
        (path.stem.partition("-")[0], path) for path in found if path.suffix in (".dist-info", ".egg-info")
    )


def _editable_folder(metadata: Path) -> Path | None:
    folder = metadata.parent  # for metadata of the older kind
    origin = metadata / "direct_url.json"
    if origin.is_file():
        from json import loads
        from urllib.parse import unquote, urlsplit

        address = loads(origin.read_bytes())
        if not address.get("dir_info", {}).get("editable"):
            return None
        folder = Path(unquote(urlsplit(address.get("url", "")).path))
    return folder if (folder / "package.xml").is_file() else None


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _listed(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except OSError:
        return []
