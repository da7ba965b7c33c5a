"""`bus interface cpp`: a C++ header for a message or a service."""

from argparse import Namespace

from bus_cli.interface.c import add_arguments, write

__all__ = ["add_arguments", "main"]


def main(args: Namespace) -> int:
    return write(args, "cpp", ".hpp")
