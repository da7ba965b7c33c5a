"""`bus launch`: run a launch file, list its arguments, or print its contents.

Uses the `launch` that can be imported: the original of ROS 2 if it is installed, else busd's.

`files.py` finds the file, `arguments.py` has its arguments, `completers.py` completes names in the shell, and
`bus.py` chooses the bus of the processes.

Invariants: this package only uses names that ROS 2's `launch` has; options and texts are the same as in
`ros2 launch`.

Read first: `files.py`. Tests: `tests/unit/bus_cli/launch/`, `tests/system/test_launch.py`.
"""

import os
from argparse import ArgumentParser, Namespace
from importlib import import_module
from typing import Any

from bus_cli.completion import completed_by
from bus_cli.exitcodes import EXIT_ERROR
from bus_cli.launch.arguments import given_arguments, misspelt
from bus_cli.launch.bus import export
from bus_cli.launch.completers import complete_file_or_package, complete_launch_words
from bus_cli.launch.files import find_launch_file
from bus_cli.output import CommandError, say
from bus_cli.program_name import program_name


def add_arguments(parser: ArgumentParser) -> None:
    parser.usage = f"{program_name()} launch [options] FILE | PKG FILE [name:=value ...]"
    parser.description = (
        "Run a launch file in Python, XML or YAML, given by its path, or by its package and name."
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "-s", "--show-args", "--show-arguments", action="store_true", help="list the file's arguments"
    )
    what.add_argument(
        "-p", "--print", "--print-description", action="store_true", help="print the launch description"
    )
    parser.add_argument("-d", "--debug", action="store_true", help="print more, also tracebacks")
    parser.add_argument("-n", "--noninteractive", action="store_true", help="log each signal that is sent")
    parser.add_argument(
        "-a",
        "--show-all-subprocesses-output",
        action="store_true",
        help="print the output of all processes, whatever their attribute `output`",
    )
    parser.add_argument(
        "--launch-prefix", metavar="COMMAND", help="command before each program, as one word: 'gdb --args'"
    )
    parser.add_argument(
        "--launch-prefix-filter", metavar="REGEX", help="only for programs with a matching name"
    )
    completed_by(
        parser.add_argument("package_or_file", metavar="FILE | PKG FILE", help="a path, or a package"),
        complete_file_or_package,
    )
    completed_by(
        parser.add_argument("words", nargs="*", metavar="name:=value", help="arguments of the launch file"),
        complete_launch_words,
    )


def main(args: Namespace) -> int:
    path, words = find_launch_file(args.package_or_file, args.words)
    arguments = given_arguments(words)
    export(args)
    if args.show_all_subprocesses_output:
        os.environ["OVERRIDE_LAUNCH_PROCESS_OUTPUT"] = "both"
    import_module("bus_ros.import_hook")
    from bus_launch import inheritance

    inheritance.prepare()
    launch: Any = import_module("launch")
    if args.print or args.show_args:
        return _show(launch, path, args)
    return _run(launch, path, arguments, args)


def _show(launch: Any, path: str, args: Namespace) -> int:
    from bus_cli.launch.arguments import listed

    sources: Any = import_module("launch.launch_description_sources")
    try:
        description = sources.get_launch_description_from_any_launch_file(path)
        if args.print:
            say(launch.LaunchIntrospector().format_launch_description(description))
        else:
            say("\n".join(listed(description.get_launch_arguments())))
    except Exception as error:
        if args.debug:
            raise
        raise CommandError(str(error)) from None
    return 0


def _run(launch: Any, path: str, arguments: dict[str, str], args: Namespace) -> int:
    actions: Any = import_module("launch.actions")
    sources: Any = import_module("launch.launch_description_sources")
    logging: Any = import_module("launch.logging")
    service = launch.LaunchService(
        argv=[f"{name}:={value}" for name, value in arguments.items()],
        noninteractive=args.noninteractive,
        debug=args.debug,
    )
    logging.log_launch_config(logger=logging.get_logger("launch"))
    given = dict(arguments)
    if args.launch_prefix is not None:
        given["launch-prefix"] = args.launch_prefix
    if args.launch_prefix_filter is not None:
        given["launch-prefix-filter"] = args.launch_prefix_filter
    source = sources.AnyLaunchDescriptionSource(path)
    for text in misspelt(arguments, source.try_get_launch_description_without_context()):
        logging.get_logger("launch").warning(text)
    include = actions.IncludeLaunchDescription(source, launch_arguments=list(given.items()))
    service.include_launch_description(launch.LaunchDescription([include]))
    code = service.run()
    ended_by = getattr(service, "ended_by", None)
    if ended_by is not None:
        return -int(ended_by)
    return EXIT_ERROR if code else 0
