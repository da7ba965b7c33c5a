"""Launch files in XML; programs import it as `launch_xml`.

`parser.py` reads a file, `entity.py` is one element. Tags and substitutions are not known here: see
`clients/bus_launch/launch/frontend/`.

Read first: `entity.py`. Tests: `tests/unit/bus_launch/launch_xml/`.
"""

from bus_launch.launch_xml.entity import Entity
from bus_launch.launch_xml.parser import Parser

__all__ = ["Entity", "Parser"]
