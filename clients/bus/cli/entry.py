"""Where the program `bus` begins: `bus run` goes its own, short way; everything else is bus.cli.main's.

A program that `bus run` runs in this process must end as Python ends one, with its exit handlers; the other
verbs end at once. And it shall not wait for a parser that it has no use for.
"""

import sys
from typing import NoReturn

from bus.cli.run import read, start
from bus.ending import die_by


def main() -> NoReturn:
    """The program."""
    call = read(sys.argv[1:])
    if call is not None:
        code = start(call)
        if code < 0:
            die_by(-code)
        sys.exit(code)
    from bus.cli import main as others

    others.main()
