"""Launch files in a markup language; programs import it as `launch.frontend`.

    file --> parser of the language (`launch_xml`, `launch_yaml`) --> `entity.py` --> `parser.py` --> actions

- `expose.py`: which class makes an action of a tag, or a substitution of `$(name ...)`.
- `grammar.py`: texts with `$(...)` in them.

Invariants: this package knows no language. A language is a subclass of `Parser` and of `Entity`. The
decorators of `expose.py` register users' tags and substitutions. `grammar.py` is pure.

Read first: `expose.py`, then `grammar.py`. Tests: `tests/unit/bus_launch/launch/frontend/`,
`tests/unit/bus_launch/launch_xml/`.
"""

from bus_launch.launch.frontend.entity import Entity
from bus_launch.launch.frontend.expose import expose_action, expose_substitution
from bus_launch.launch.frontend.grammar import parse_substitution
from bus_launch.launch.frontend.parser import InvalidFrontendLaunchFileError, Parser

__all__ = [
    "Entity",
    "InvalidFrontendLaunchFileError",
    "Parser",
    "expose_action",
    "expose_substitution",
    "parse_substitution",
]
