"""Where the program `bus` begins: `bus run` goes its own, short way; everything else is bus_cli.main's.

A program that `bus run` runs in this process must end as Python ends one, with its exit handlers; the other
verbs end at once. And it must not wait for a parser that it does not use.
"""

import sys
from typing import NoReturn

from bus.process.termination import die_at_interrupt, die_now, say_nothing_of_signals
from bus_cli.run import read, start


def main() -> NoReturn:
    """The program."""
    try:
        _main()
    except KeyboardInterrupt:
        say_nothing_of_signals()
        raise


def _main() -> NoReturn:
    call = read(sys.argv[1:])
    if call is not None:
        code = start(call)
        if code < 0:
            die_now(-code)
        sys.exit(code)
    # Nothing is to be tidied up yet: one that comes while modules load must not be taken for their error.
    die_at_interrupt()
    from bus_cli import main as others

    others.main()
