"""`bus pkg create`: write a package that pip can install and colcon can build."""

from argparse import ArgumentParser, Namespace
from datetime import date
from pathlib import Path

from bus_cli.output import CommandError, complain, say
from bus_cli.pkg import templates
from bus_cli.pkg.templates import Description

_LICENSES = Path(__file__).parent / "licenses"
_BUILD_TYPES = ("cmake", "ament_cmake", "ament_cargo", "ament_python")
_POSSIBLE = "ament_python"
_NO_LICENSE = (
    "\n[WARNING]: Unknown license '{}'.  This has been set in the package.xml, but no LICENSE file has been "
    "created.\nIt is recommended to use one of the ament license identifiers:\n{}"
)
_EXISTS = (
    "\nAborted!\nThe directory already exists: {}\nEither remove the directory or choose a different "
    "destination directory or package name"
)
_IS_TEST = (
    "Aborted since 'ament_python' packages can't be named 'test'. Please choose a different package name."
)
_CONVENTIONS = (
    'Package name "{}" does not follow the naming conventions. It should start with a lower case letter and '
    "only contain lower case letters, digits, underscores, and dashes."
)


def add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("package_name", help="The package name")
    parser.add_argument(
        "--package-format",
        "--package_format",
        type=int,
        default=3,
        choices=[2, 3],
        help="The package.xml format.",
    )
    parser.add_argument(
        "--description",
        default="TODO: Package description",
        help="The description given in the package.xml",
    )
    parser.add_argument(
        "--license",
        default="TODO: License declaration",
        help="The license attached to this package; '?' lists the ones with a LICENSE file",
    )
    parser.add_argument(
        "--destination-directory", default=".", help="Directory where to create the package directory"
    )
    parser.add_argument(
        "--build-type",
        default="ament_cmake",
        choices=_BUILD_TYPES,
        help=f"The build type to process the package with; here it must be {_POSSIBLE}",
    )
    parser.add_argument("--dependencies", nargs="+", default=[], help="list of dependencies")
    parser.add_argument("--maintainer-email", help="email address of the maintainer of this package")
    parser.add_argument("--maintainer-name", help="name of the maintainer of this package")
    parser.add_argument("--node-name", help="name of the empty executable")
    parser.add_argument("--library-name", help="name of the empty library")


def main(args: Namespace) -> int:
    if args.license == "?":
        say(f"Supported licenses:\n{_license_names()}")
        return 0
    package, library = _describe(args)
    _check(args, package, library)
    where = f"{args.destination_directory}/{package.name}"
    if Path(where).exists():
        raise CommandError(_EXISTS.format(where))
    _announce(package, library, args.destination_directory)
    _write(package, library, where)
    text = _license_text(package)
    if text is None:
        say(_NO_LICENSE.format(package.license, _license_names()))
    else:
        Path(where, "LICENSE").write_text(text, encoding="utf-8")
    return 0


def _describe(args: Namespace) -> tuple[Description, str | None]:
    name = args.maintainer_name or _user()
    node = args.node_name
    if node and node == args.library_name:
        node = f"{node}_node"
        complain("[WARNING] node name can not be equal to the library name")
        complain(f"[WARNING] renaming node to {node}")
    package = Description(
        name=args.package_name,
        description=args.description,
        maintainer=name,
        email=args.maintainer_email or _email() or f"{name}@todo.todo",
        license=args.license,
        dependencies=tuple(args.dependencies),
        node=node,
        format=args.package_format,
    )
    return package, args.library_name


def _check(args: Namespace, package: Description, library: str | None) -> None:
    """Raises CommandError, before anything is written, if the options do not describe a package."""
    if args.build_type != _POSSIBLE:
        raise CommandError(
            f"busd has no build type '{args.build_type}': it runs Python. Use --build-type {_POSSIBLE}"
        )
    if package.name == "test":
        raise CommandError(_IS_TEST)
    if not package.name[:1].isalpha() or not _is_importable(package.name):
        raise CommandError(_CONVENTIONS.format(package.name))
    if package.name != package.name.lower():
        complain(f"[WARNING]: {_CONVENTIONS.format(package.name)}")
    for what, name in (("node", package.node), ("library", library)):
        if name is not None and not _is_importable(name):
            raise CommandError(f"the {what} name '{name}' can't be a Python module")


def _is_importable(name: str) -> bool:
    from keyword import iskeyword

    return name.isascii() and name.isidentifier() and not iskeyword(name)


def _announce(package: Description, library: str | None, destination: str) -> None:
    say("going to create a new package")
    say("package name:", package.name)
    say("destination directory:", Path(destination).absolute())
    say("package format:", package.format)
    say("version: 0.0.0")
    say("description:", package.description)
    say("maintainer:", [f"{package.maintainer} <{package.email}>"])
    say("licenses:", [package.license])
    say("build type:", _POSSIBLE)
    say("dependencies:", [*package.dependencies])
    if package.node:
        say("node_name:", package.node)
    if library:
        say("library_name:", library)


def _write(package: Description, library: str | None, where: str) -> None:
    _make_folder(where)
    _make_file(where, "package.xml", templates.package_xml(package))
    say("creating source folder")
    source = _make_folder(f"{where}/{package.name}")
    _make_file(where, "setup.py", templates.setup_py(package))
    _make_file(where, "setup.cfg", templates.setup_cfg(package))
    resource = _make_folder(f"{where}/resource")
    _make_file(resource, package.name, "")
    _make_file(source, "__init__.py", "")
    test = _make_folder(f"{where}/test")
    for linter in templates.LINTERS:
        _make_file(test, f"test_{linter}.py", templates.linter_test(linter))
    if package.node:
        _make_file(source, f"{package.node}.py", templates.node(package))
    if library:
        folder = _make_folder(f"{source}/{library}")
        _make_file(folder, "__init__.py", "")


def _make_folder(path: str) -> str:
    say("creating folder", path)
    Path(path).mkdir(parents=True, exist_ok=True)
    return path


def _make_file(folder: str, name: str, text: str) -> None:
    path = f"{folder}/{name}"
    say("creating", path)
    Path(path).write_text(text, encoding="utf-8")


def _license_names() -> str:
    return "\n".join(sorted(path.stem for path in _LICENSES.glob("*.txt")))


def _license_text(package: Description) -> str | None:
    path = _LICENSES / f"{package.license}.txt"
    if package.license not in _license_names().splitlines():
        return None
    text = path.read_text(encoding="utf-8")
    return text.replace("{holder}", f"{date.today().year} {package.maintainer}")


def _user() -> str:
    from getpass import getuser

    try:
        return getuser()
    except (KeyError, OSError):  # a user without a name
        return "TODO"


def _email() -> str | None:
    """The e-mail address in git's configuration."""
    import subprocess

    try:
        asked = subprocess.run(["git", "config", "user.email"], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return asked.stdout.strip() or None
