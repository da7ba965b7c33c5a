"""`bus run`: a script, a module, or a program of a package.

Parses its command line itself, because argparse costs as much as the rest of the start. argparse prints the
help, and the errors of command lines that `read` does not accept.
"""

# pathlib would add milliseconds to the start of each script:
# ruff: noqa: PTH110, PTH113, PTH118, PTH208
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from bus_cli.exitcodes import EXIT_ERROR, EXIT_USAGE
from bus_cli.output import complain
from bus_cli.program_name import program_name

if TYPE_CHECKING:
    from argparse import ArgumentParser, Namespace
    from pathlib import Path

    from bus_ros.packages import Executable

_SWITCHES = ("--force", "--json", "--include-hidden-topics", "--no-daemon", "-s", "--use-sim-time")
_VALUED = ("--prefix", "--socket", "--domain", "--spin-time")
_OWN = ("--force", "--prefix")
_USAGE = "run [options] script.py [args] | -m module [args] | PKG EXE [args]"


class _Refused(Exception):
    """The call is impossible; the last line may be a hint."""

    def __init__(self, text: str, hint: str | None = None, code: int = EXIT_ERROR) -> None:
        super().__init__(text)
        self.lines = [text, hint] if hint else [text]
        self.code = code


class Call(NamedTuple):
    """The parsed command line of `bus run`."""

    words: Sequence[str]
    """Script and arguments; or package, program and arguments; or, for a module, only arguments."""
    module: str | None = None
    force: bool = False
    prefix: str | None = None
    socket: str | None = None
    domain: int | None = None


def read(words: Sequence[str]) -> Call | None:
    """Parse a command line; returns None if it is not a `bus run`, or if argparse must handle it."""
    options: dict[str, str] = {}
    if "_ARGCOMPLETE" in os.environ:
        return None
    is_run = False
    at = 0
    while at < len(words):
        word, at = words[at], at + 1
        name, equals, value = word.partition("=")
        if name in _OWN and not is_run:
            return None
        if word in _SWITCHES:
            options[word] = ""
        elif name in _VALUED:
            if not equals:
                if at == len(words):
                    return None
                value, at = words[at], at + 1
            options[name] = value
        elif not is_run:
            if word != "run":
                return None
            is_run = True
        elif word == "--" and at < len(words):
            return _call(options, words[at:], None)
        elif word == "-m" and at < len(words):
            return _call(options, words[at + 1 :], words[at])
        elif word.startswith("-"):
            return None
        else:
            return _call(options, words[at - 1 :], None)
    return None


def start(call: Call) -> int:
    """Run the program. Returns the exit code of a child, or minus the number of a signal to die by. If the
    call is impossible, prints the error to stderr and returns its code. A program that runs in this process
    ends it.
    """
    from bus.errors import BusError
    from bus.process.start_errors import check_descriptors

    try:
        check_descriptors()
        _export(call)
        return _start(call)
    except _Refused as refused:
        complain("\n".join(refused.lines))
        return refused.code
    except OSError as error:  # an error of the start: exceptions of a program do not reach this line
        complain(f"{program_name()} run: can't run '{error.filename}': {error.strerror}")
    except BusError as error:
        complain(error)
    return EXIT_ERROR


def add_arguments(parser: "ArgumentParser") -> None:
    from argparse import REMAINDER

    parser.usage = f"{program_name()} {_USAGE}"
    parser.allow_abbrev = False
    parser.description = (
        "Run a Python script or module, or a program of a package. If ROS 2's modules (rclpy, std_msgs, ...) "
        "are not installed, busd's are used. All words after the program belong to it, also --ros-args."
    )
    parser.add_argument("-m", dest="module", metavar="module", help="run a module, as python -m does")
    parser.add_argument(
        "--force", action="store_true", help="use busd's modules even if ROS 2's are installed"
    )
    parser.add_argument(
        "--prefix", metavar="COMMAND", help="command before the program, as one word: 'gdb --args'"
    )
    words = parser.add_argument(
        "words", nargs=REMAINDER, metavar="script.py | PKG EXE", help="the program, its arguments"
    )
    if "_ARGCOMPLETE" in os.environ:
        from bus_cli.completion import completed_by
        from bus_cli.launch.completers import complete_run_words

        completed_by(words, complete_run_words)
    parser.set_defaults(usage=parser.error)


def main(args: "Namespace") -> int:
    if not args.words and args.module is None:
        args.usage("the following arguments are required: script.py, or -m module, or PKG EXE")
    return start(Call(args.words, args.module, args.force, args.prefix, args.socket, args.domain))


def _call(options: dict[str, str], words: Sequence[str], module: str | None) -> Call | None:
    domain = options.get("--domain")
    try:
        number = None if domain is None else int(domain)
    except ValueError:
        return None
    return Call(words, module, "--force" in options, options.get("--prefix"), options.get("--socket"), number)


def _export(call: Call) -> None:
    """Choose the bus for the program and for its child processes."""
    if call.socket is None and call.domain is None:
        return
    from bus.process.address import domain_id, socket_path

    if call.domain is not None:
        os.environ["BUSD_DOMAIN"] = str(domain_id(call.domain))
        os.environ.pop("BUSD_SOCKET", None)  # it would override the domain
    if call.socket is not None:
        os.environ["BUSD_SOCKET"] = str(socket_path(call.socket))


def _start(call: Call) -> int:
    from bus_ros import running

    program = None if call.module is not None or _is_script(call.words) else _find(call.words)
    is_plain_executable = program and program.entry_point is None and not running.is_python(program.path)
    front = _split(call.prefix)
    if program and is_plain_executable:
        return running.run_child([*front, program.path, *call.words[2:]], of_package=True)
    if front:
        # A Python program has no command for the prefix, so the child runs this tool again.
        again = ["--force"] if call.force else []
        again += ["-m", call.module] if call.module is not None else []
        return running.run_child([*front, sys.executable, "-m", "bus_cli", "run", *again, *call.words])
    running.fill_in(force=call.force)
    return _run_here(call, program)


def _run_here(call: Call, program: "Executable | None") -> NoReturn:
    from bus_ros import running

    if call.module is not None:
        running.run_module(call.module, call.words)
    if program is None:
        running.run_script(call.words[0], call.words[1:])
    if program.entry_point is not None:
        running.run_entry_point(program.entry_point, program.path, call.words[2:])
    running.run_script(program.path, call.words[2:], of_package=True)


def _split(prefix: str | None) -> list[str]:
    if prefix is None:
        return []
    import shlex

    try:
        return shlex.split(prefix)
    except ValueError as error:
        raise _Refused(f"{program_name()} run: --prefix {prefix!r}: {error}") from None


def _is_script(words: Sequence[str]) -> bool:
    target = words[0]
    is_path = target.endswith((".py", ".pyz")) or os.sep in target
    if is_path and not os.path.exists(target):
        raise _Refused(f"{program_name()} run: '{target}' does not exist", _near_file(target))
    return is_path or (len(words) == 1 and os.path.isfile(target))


def _find(words: Sequence[str]) -> "Executable":
    """Find a program by the names of its package and itself."""
    from bus_ros import packages

    package = words[0]
    found, compiled = packages.executables(package), set[str]()
    if found is None:
        found, compiled = _find_source(package)
    present = [one.name for one in found]
    if len(words) < 2 or words[1].startswith("-"):
        problem = f"{program_name()} run: error: the following arguments are required: executable_name"
        hint = f"'{package}' has: {', '.join(present)}" if present else None
        raise _Refused(f"usage: {program_name()} {_USAGE}\n{problem}", hint, EXIT_USAGE)
    fitting = [one for one in found if one.name == words[1]]
    if not fitting:
        if words[1] in compiled:
            hint = (
                f"'{words[1]}' must be compiled, with colcon and ROS 2: bus runs Python programs from source"
            )
            raise _Refused("No executable found", hint)
        raise _Refused("No executable found", _executable_hint(package, words[1], present))
    if len(fitting) > 1:
        raise _Refused("Multiple executables found:\n" + "\n".join(f"- {one.path}" for one in fitting))
    program = fitting[0]
    if not program.prefix.is_sourced:
        _source(program.python_folders)
    elif program.entry_point is None and not program.prefix.is_ours:
        _add_python(packages.python_folders(program.prefix))
    return program


def _find_source(package: str) -> "tuple[list[Executable], set[str]]":
    """Programs of a package in source form, which need not be installed; and names of programs to compile."""
    from bus_ros import packages

    folder = packages.source_folder(package)
    found = packages.source_programs(folder) if folder is not None else None
    is_python = folder is not None and os.path.isfile(os.path.join(folder, "setup.py"))
    if folder is None or found is None or (is_python and not any(found)):
        raise _Refused(f"Package '{package}' not found", _package_hint(package, folder))
    if not any(found):
        place = os.path.join(os.path.relpath(folder), "CMakeLists.txt")
        hint = f"'{place}' installs no programs: install(PROGRAMS ... DESTINATION lib/${{PROJECT_NAME}})"
        raise _Refused(f"Package '{package}' not found", hint)
    return found


def _source(folders: "Sequence[str]") -> None:
    """Do the same as sourcing the set-up of the workspace. The Python folders `folders` come first."""
    from bus_ros import packages

    new = [prefix for prefix in packages.prefixes() if not prefix.is_sourced]
    old = os.environ.get("AMENT_PREFIX_PATH")
    if new:
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join(
            [str(one.path) for one in new] + ([old] if old else [])
        )
    _add_python([*folders, *(folder for prefix in new for folder in packages.python_folders(prefix))])


def _add_python(folders: "Sequence[str]") -> None:
    from bus_ros import running

    missing = [folder for folder in folders if folder not in sys.path[1:]]
    if missing:
        running.add_paths(missing)


def _package_hint(package: str, source: "Path | None") -> str | None:
    from bus_ros import packages

    if os.path.isfile(f"{package}.py"):
        return f"did you mean '{package}.py'?"
    if source is not None:
        folder = os.path.relpath(source)
        return f"'{folder}' is not installed: pip install -e ./{folder}, or build it with colcon"
    near = packages.nearest(package)
    return f"did you mean '{near}'?" if near else None


def _executable_hint(package: str, name: str, present: list[str]) -> str | None:
    from bus.base.suggest import nearest

    near = nearest(name, present)
    if near:
        return f"did you mean '{near}'?"
    return f"'{package}' has: {', '.join(present)}" if present else None


def _near_file(path: str) -> str | None:
    from bus.base.suggest import nearest

    folder, name = os.path.split(path)
    try:
        files = [one for one in os.listdir(folder or ".") if one.endswith(".py")]
    except OSError:
        return None
    near = nearest(name, files)
    return f"did you mean '{os.path.join(folder, near)}'?" if near else None
