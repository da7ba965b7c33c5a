"""`bus test`: run a test file of launch_testing."""

from argparse import ArgumentParser, Namespace
from importlib import import_module
from typing import Any

from bus.process.termination import heed_interrupts
from bus_cli.launch.arguments import given_arguments
from bus_cli.launch.bus import export
from bus_cli.output import CommandError
from bus_cli.program_name import program_name


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = (
        "Run a test file of launch_testing: start the description of its generate_test_description(), and "
        "run its unittest classes during the launch and after it."
    )
    parser.add_argument("-v", "--verbose", action="store_true", help="print the name of each test")
    parser.add_argument("test_file", help="the file")
    parser.add_argument("arguments", nargs="*", metavar="name:=value", help="arguments of the launch")


def main(args: Namespace) -> int:
    given_arguments(args.arguments)
    if not args.test_file.endswith(".py"):
        raise CommandError(f"{program_name()} test: '{args.test_file}' is not a Python file")
    heed_interrupts()  # a test file may have something to tidy up
    export(args)
    import_module("bus_ros.import_hook")
    from bus_launch import inheritance

    inheritance.prepare()
    program: Any = import_module("launch_testing.launch_test")
    words = [*(["-v"] if args.verbose else []), args.test_file, *args.arguments]
    code: int = program.main(words)
    return code
