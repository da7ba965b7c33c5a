"""Launch files in a markup language; programs import it as `launch.frontend`."""

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
