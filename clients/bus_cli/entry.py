"""Where the program `bus` begins: `bus run` goes its own, short way; everything else is bus_cli.main's.

A program that `bus run` runs in this process must end as Python ends one, with its exit handlers; the other
verbs end at once. And it must not wait for a parser that it does not use. Importing this belongs to the
program: from here on a Ctrl-C ends it at once, until a verb has something to tidy up and says so, by
`heed_interrupts` or handlers of its own.
"""

import _signal  # type: ignore[import-not-found] # what `signal` is made of, and there without loading anything

# Before anything is loaded: a KeyboardInterrupt in the middle of that would be shown, or be taken for an
# error of a module. An ignored signal stays ignored.
if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

import sys
from typing import NoReturn

from bus.process.termination import die_now, say_nothing_of_signals
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
    from bus_cli import main as others

    others.main()
