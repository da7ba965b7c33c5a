"""Orders that come as JSON lines on stdin, and what is answered and told on stdout, one JSON line each.

Knows no library of messages: it is imported by programs of several Pythons.
"""

import json
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

_writing = threading.Lock()


def tell(**event: Any) -> None:
    """From any thread."""
    line = json.dumps(event) + "\n"
    with _writing:
        sys.stdout.write(line)
        sys.stdout.flush()


def serve(orders: Mapping[str, Callable[..., Any]]) -> None:
    """Answer to each order, with its arguments, until there are no more.

    An order that fails is answered with the error, so that the test shows it.
    """
    tell(answer="ready")
    for line in sys.stdin:
        order, arguments = json.loads(line)
        try:
            answer = orders[order](**arguments)
        except Exception as error:
            tell(error=f"{order}: {type(error).__name__}: {error}")
        else:
            tell(answer=answer)
