"""The program `bus`: its commands and verbs, their parsers, exit codes.

Only imports the module of the chosen verb, so verbs without an event loop do not load one. A verb's module
has `add_arguments(parser)` and `main(args)`. `main` returns the exit code, or raises CommandError (or a
BusError) with a text for the user.
"""

import io
import os
import signal
import sys
from argparse import (
    SUPPRESS,
    Action,
    ArgumentParser,
    HelpFormatter,
    Namespace,
    RawDescriptionHelpFormatter,
    _SubParsersAction,
)
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from typing import Any, NoReturn

from bus.base.loading import loading
from bus.base.version import RELEASE
from bus.errors import BusError
from bus.process.termination import Terminated, die_now
from bus_cli.exitcodes import EXIT_ERROR, EXIT_USAGE
from bus_cli.output import CommandError, complain, say
from bus_cli.program_name import program_name

COMMANDS: dict[str, tuple[str, dict[str, str]]] = {
    "topic": (
        "Various topic related sub-commands",
        {
            "bw": "Display bandwidth used by topic",
            "delay": "Display delay of topic from timestamp in header",
            "echo": "Output messages from a topic",
            "find": "Output a list of available topics of a given type",
            "hz": "Print the average receiving rate to screen",
            "info": "Print information about a topic",
            "list": "Output a list of available topics",
            "pub": "Publish a message to a topic",
            "type": "Print a topic's type",
        },
    ),
    "node": (
        "Various node related sub-commands",
        {
            "info": "Output information about a node",
            "list": "Output a list of available nodes",
        },
    ),
    "service": (
        "Various service related sub-commands",
        {
            "call": "Call a service",
            "echo": "Echo a service",
            "find": "Output a list of available services of a given type",
            "info": "Output information about a service",
            "list": "Output a list of available services",
            "type": "Output a service's type",
        },
    ),
    "action": (
        "Various action related sub-commands",
        {
            "find": "Output a list of available actions of a given type",
            "info": "Print information about an action",
            "list": "Output a list of action names",
            "send_goal": "Send an action goal",
            "type": "Print an action's type",
        },
    ),
    "component": (
        "Various component related sub-commands",
        {
            "list": "Output a list of running containers and components",
            "load": "Load a component into a container node",
            "standalone": "Run a component into its own standalone container node",
            "types": "Output a list of components registered by packages",
            "unload": "Unload a component from a container node",
        },
    ),
    "lifecycle": (
        "Various lifecycle related sub-commands",
        {
            "get": "Get lifecycle state for one or more nodes",
            "list": "Output a list of available transitions",
            "nodes": "Output a list of nodes with lifecycle",
            "set": "Trigger lifecycle state transition",
        },
    ),
    "tf2": (
        "Various tf2 related sub-commands",
        {
            "echo": "Print the transform between two frames",
            "frames": "Draw the tree of frames",
            "monitor": "Print the delay and rate of transforms",
        },
    ),
    "bag": (
        "Various rosbag related sub-commands",
        {
            "burst": "Burst data from a bag",
            "convert": "Given an input bag, write out a new bag with different settings",
            "info": "Print information about a bag to the screen",
            "list": "Print information about available plugins to the screen",
            "play": "Play back ROS data from a bag",
            "record": "Record ROS data to a bag",
            "reindex": "Reconstruct metadata file for a bag",
        },
    ),
    "bridge": (
        "Join the bus of this machine with others",
        {
            "ros2": "Join the bus with ROS 2, by DDS or zenoh, until Ctrl-C",
            "status": "Output links, routes and counters of bridges",
            "zenoh": "Join the buses of several machines, by zenoh, until Ctrl-C",
        },
    ),
    "daemon": (
        "Various daemon related sub-commands",
        {
            "install": "Write systemd units for the daemon",
            "peers": "Output the daemon's resources used by each process",
            "reload": "Have the daemon read its configuration again",
            "restart": "Restart the daemon without a gap",
            "start": "Start the daemon if it isn't running",
            "status": "Output the status of the daemon",
            "stop": "Stop the daemon if it is running",
            "uninstall": "Remove the systemd units of the daemon",
        },
    ),
    "interface": (
        "Show information about ROS interfaces",
        {
            "c": "Output a C header for a message or a service",
            "cpp": "Output a C++ header for a message or a service",
            "list": "List all interface types available",
            "package": "Output a list of available interface types within one package",
            "packages": "Output a list of packages that provide interfaces",
            "proto": "Output an interface prototype",
            "show": "Output the interface definition",
        },
    ),
    "param": (
        "Various param related sub-commands",
        {
            "delete": "Delete parameter",
            "describe": "Show descriptive information about declared parameters",
            "dump": "Show all of the parameters of a node as YAML",
            "get": "Get parameter",
            "list": "Output a list of available parameters",
            "load": "Load parameter file for a node",
            "set": "Set parameter",
        },
    ),
    "bench": (
        "Measure the bus on this machine, with separate processes",
        {
            "fanout": "One publisher to many subscribers",
            "latency": "Age of messages when they arrive",
            "throughput": "Messages a second, and losses",
        },
    ),
    "top": ("Show topics and nodes, with their rates and losses, live", {}),
    "metrics": ("Serve metrics of the bus to Prometheus", {}),
    "web": ("Show the bus in a browser: graph, rates, values, plots and log", {}),
    "run": ("Run a script, a module or a program of a package", {}),
    "launch": ("Run a launch file", {}),
    "test": ("Run a test file of launch_testing", {}),
    "pkg": (
        "Various package related sub-commands",
        {
            "create": "Create a new ROS 2 package",
            "executables": "Output a list of package specific executables",
            "list": "Output a list of available packages",
            "prefix": "Output the prefix path of a package",
            "xml": "Output the manifest of a package, or a tag of it",
        },
    ),
    "doctor": (
        "Check the set-up and advise how to correct faults",
        {"hello": "Check network connectivity between multiple hosts"},
    ),
    "wtf": (
        "Use `wtf` as alias to `doctor`",
        {"hello": "Check network connectivity between multiple hosts"},
    ),
    "multicast": (
        "Various multicast related sub-commands",
        {
            "receive": "Receive a single UDP multicast packet",
            "send": "Send a single UDP multicast packet",
        },
    ),
    "ros2": (
        "The name ros2 for this program, on machines without ROS 2",
        {
            "install": "Write a program ros2 that runs bus",
            "uninstall": "Remove the program ros2 that install wrote",
        },
    ),
    "completion": ("Print the shell code that completes bus commands", {}),
}
"""For each command, its help and its verbs. A command without verbs is a verb itself."""

VERBS_WITH_VERBS = ("doctor", "wtf")
"""Commands that are verbs themselves and also have verbs."""

_STARTS = "--conformance"
"""The option that has the command line of a program after it."""
_VALUED = ("--story", "--wait", "--socket", "--domain")
"""Options with a value that may come between."""

_MODULES = {"wtf": "doctor"}
"""Modules of commands that have another name."""

_EPILOG = """\
{verbs}
exit status: 0 done, 1 an error (its text is on stderr), 2 wrong usage.
Ctrl-C and SIGTERM end it as they end any program: 130 and 143 in a shell
see also: busd --help
"""


def main() -> NoReturn:
    """Run the program."""
    _open_closed_streams()
    try:
        code = run(sys.argv[1:])
    except SystemExit as end:  # from argparse, which has printed its error, or from a launch file
        code = end.code or 0 if isinstance(end.code, int | None) else EXIT_ERROR
        if isinstance(end.code, str):
            complain(end.code)
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except OSError:  # the reader is gone; earlier output has reported any other fault
        pass
    if code < 0:
        die_now(-code)
    # Skip the end of the interpreter: it costs as much as a quarter of `bus topic list`. It would also abort
    # if a thread still reads the standard input.
    os._exit(code)


def _open_closed_streams() -> None:
    """Open /dev/null for closed streams (`>&-`). Else a new socket could get the number of stdout."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


def run(words: Sequence[str]) -> int:
    """Run one command line; returns its exit code, or minus the number of the signal to die by."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True, errors="backslashreplace")
    try:
        return _run(words)
    except BrokenPipeError:
        return 0  # the reader of the output has ended
    except KeyboardInterrupt as interrupt:
        return -(signal.SIGTERM if isinstance(interrupt, Terminated) else signal.SIGINT)
    except (CommandError, BusError, OSError) as error:
        complain(error)
        return EXIT_ERROR


def _run(words: Sequence[str]) -> int:
    if "_ARGCOMPLETE" in os.environ:
        _complete()
    words, program = own_words(words)
    args = make_parser(words).parse_args(words)
    args.program = program
    if args.version:
        say(f"bus {RELEASE}")
        return 0
    code: int = args.main(args) or 0
    return code


def own_words(words: Sequence[str]) -> tuple[Sequence[str], Sequence[str]]:
    """The words of this program, and the command line that `bus doctor --conformance` starts.

    That begins after `--`, or with the first word that is no option: argparse would take it for a verb.
    """
    at = words.index(_STARTS) + 1 if _STARTS in words else len(words)
    while at < len(words):
        if words[at] == "--":
            return words[:at], words[at + 1 :]
        if not words[at].startswith("-"):
            return words[:at], words[at:]
        at += 2 if words[at] in _VALUED else 1
    return words, ()


class _Parser(ArgumentParser):
    """Suggests a similar command, verb or option if the given one does not exist."""

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        parsed, unknown = self.parse_known_args(args, namespace)
        if unknown:
            # argparse would print the usage of all of `bus`.
            getattr(parsed, "parser", self).error(f"unrecognized arguments: {' '.join(unknown)}")
        return parsed

    def error(self, message: str) -> NoReturn:
        what, _, words = message.partition("unrecognized arguments: ")
        if words.startswith("--") and not what:
            from bus.base.suggest import did_you_mean

            message += did_you_mean(words.split()[0].partition("=")[0], _options(self), 0.75)
        super().error(message)

    def _check_value(self, action: Action, value: Any) -> None:
        if action.choices is None or value in action.choices or not isinstance(action, _SubParsersAction):
            super()._check_value(action, value)
            return
        from bus_cli.suggestions import no_command, no_verb

        is_command = self.prog == program_name()
        complain(no_command(value, COMMANDS) if is_command else no_verb(self.prog, value, action.choices))
        self.exit(EXIT_USAGE)


def _options(parser: ArgumentParser) -> Iterator[str]:
    """All options of a parser and of its subparsers."""
    for action in parser._actions:
        yield from action.option_strings
        if isinstance(action, _SubParsersAction):
            for below in action.choices.values():
                yield from _options(below)


class _VerbParser(_Parser):
    """Allows options between arguments, as in `pub /topic TYPE --once VALUES`."""

    _is_within = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        # The intermixed variant calls this method again; argcomplete only works with the plain one.
        if self._is_within or "_ARGCOMPLETE" in os.environ:
            return super().parse_known_args(args, namespace)
        self._is_within = True
        return self.parse_known_intermixed_args(args, namespace)


class _Formatter(HelpFormatter):
    """Gets the width of the terminal without `shutil`, which argparse would import only for that."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=_help_width())


class _RawFormatter(_Formatter, RawDescriptionHelpFormatter):
    """Keeps the lines of an epilog as they are."""


@cache
def _help_width() -> int:
    try:
        columns = int(os.environ.get("COLUMNS") or 0) or os.get_terminal_size().columns
    except (ValueError, OSError):
        columns = 80
    return max(columns, 40) - 2


def make_parser(words: Sequence[str]) -> ArgumentParser:
    """The parser for `words`: it has all commands, but arguments only for the verbs in `words`."""
    parser = _Parser(
        prog=program_name(),
        description="Look at and take part in the message bus of this machine.",
        epilog=_EPILOG.format(verbs=_list_verbs()),
        formatter_class=_RawFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    # An option of ros2. Here, output to pipes always appears line by line.
    parser.add_argument("--use-python-default-buffering", action="store_true", help=SUPPRESS)
    _add_common_options(parser, None)
    parser.set_defaults(main=_print_help(parser), json=False, include_hidden_topics=False)
    commands = parser.add_subparsers(title="commands", metavar="command", prog=program_name())
    for command, (text, verbs) in COMMANDS.items():
        if command not in words:
            _name(commands, command, text)
            continue
        below = commands.add_parser(command, help=text, description=text, formatter_class=_Formatter)
        if not verbs or command in VERBS_WITH_VERBS:
            _fill(below, module_of(command))
        else:
            below.set_defaults(main=_print_help(below), parser=below)
            _add_common_options(below, SUPPRESS)
        if not verbs:
            continue
        choices = below.add_subparsers(
            title="verbs", metavar="verb", prog=f"{program_name()} {command}", parser_class=_VerbParser
        )
        for verb, what in verbs.items():
            if verb not in words:
                _name(choices, verb, what)
                continue
            leaf: ArgumentParser = choices.add_parser(
                verb, help=what, description=what, formatter_class=_Formatter
            )
            _fill(leaf, module_of(command, verb))
    return parser


@cache
def _no_arguments() -> ArgumentParser:
    return _VerbParser(add_help=False)


def _name(choices: "_SubParsersAction[Any]", word: str, text: str) -> None:
    """Offer a word that was not typed, as `add_parser` does, but without the cost of another parser."""
    choices._choices_actions.append(choices._ChoicesPseudoAction(word, (), text))
    choices._name_parser_map[word] = _no_arguments()


def module_of(command: str, verb: str = "") -> str:
    """The module of a verb, or of a command that is a verb itself."""
    return ".".join(filter(None, ("bus_cli", _MODULES.get(command, command), verb)))


def version(distribution: str) -> str | None:
    """Version of a distribution; None if it is not installed."""
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as installed

    try:
        return installed(distribution)
    except PackageNotFoundError:
        return None


def _list_verbs() -> str:
    lines = [
        f"  {command} {verb:<{20 - len(command)}}  {what}\n"
        for command, (_, verbs) in COMMANDS.items()
        for verb, what in verbs.items()
    ]
    return f"verbs:\n{''.join(lines)}"


def _fill(parser: ArgumentParser, module: str) -> None:
    with loading():
        verb: Any = import_module(module)
    verb.add_arguments(parser)
    _add_common_options(parser, SUPPRESS)
    parser.set_defaults(main=verb.main, parser=parser)


def _add_common_options(parser: ArgumentParser, default: str | None) -> None:
    """Add the options of every verb. SUPPRESS as `default` keeps a value given before the verb."""
    group = parser.add_argument_group("common options")
    group.add_argument("--socket", metavar="PATH", default=default, help="busd's socket ($BUSD_SOCKET)")
    group.add_argument(
        "--domain",
        metavar="N",
        type=int,
        default=default,
        help="a separate bus on this machine ($BUSD_DOMAIN)",
    )
    group.add_argument("--json", action="store_true", default=SUPPRESS, help="print one JSON object per line")
    group.add_argument(
        "--include-hidden-topics", action="store_true", default=SUPPRESS, help="hidden topics too"
    )
    # Options of ros2, without effect here.
    group.add_argument("--no-daemon", action="store_true", default=SUPPRESS, help=SUPPRESS)
    group.add_argument("--spin-time", metavar="S", type=float, default=SUPPRESS, help=SUPPRESS)
    # Some verbs use -s for another option.
    short = [] if "-s" in parser._option_string_actions else ["-s"]
    group.add_argument(*short, "--use-sim-time", action="store_true", default=SUPPRESS, help=SUPPRESS)


def _print_help(parser: ArgumentParser) -> Any:
    def print_help(args: Namespace) -> int:
        parser.print_help()
        return 0

    return print_help


def _complete() -> None:
    import argcomplete

    words = os.environ.get("COMP_LINE", "").split()
    argcomplete.autocomplete(make_parser(words))
