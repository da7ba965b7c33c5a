"""Launch files in YAML; programs import it as `launch_yaml`.

`parser.py` reads a file and bounds its size with all aliases, `entity.py` is one element. Tags and
substitutions are not known here: see `clients/bus_launch/launch/frontend/`.

Read first: `entity.py`. Tests: `tests/unit/bus_launch/launch_xml/`, `tests/unit/bus_launch/launch/frontend/`.
"""

from bus_launch.launch_yaml.entity import Entity
from bus_launch.launch_yaml.parser import Parser

__all__ = ["Entity", "Parser"]
