"""The start of the program `busd`: until it can end in order, a Ctrl-C ends it at once.

Importing this belongs to the program.
"""

import _signal  # type: ignore[import-not-found] # what `signal` is made of, and there without loading anything

# Before anything is loaded, as in bus_cli.entry. An ignored signal stays ignored.
if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from busd.run import main

__all__ = ["main"]
