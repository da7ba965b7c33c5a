"""Start of the program `bus`: `bus run` has a short separate way; bus_cli.main does everything else.

There are two reasons for the separate way. A program that `bus run` runs in this process must end like any
Python program, with its exit handlers; the other verbs end at once. And it must not wait for a parser that it
does not use. Only the program imports this module: after the import, Ctrl-C ends the process at once. A verb
that has something to clean up changes that with `heed_interrupts` or with signal handlers.
"""

import _signal  # type: ignore[import-not-found] # the core of `signal`; built in, so it loads no file

# Do this before all other imports: a KeyboardInterrupt during an import would print a traceback, or would
# look like an error of a module. An ignored signal stays ignored.
if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

import sys
from typing import NoReturn

from bus.process.termination import die_now, say_nothing_of_signals
from bus_cli.run import read, start


def main() -> NoReturn:
    """Run the program."""
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
