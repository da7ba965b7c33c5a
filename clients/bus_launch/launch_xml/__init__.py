"""Launch files in XML; programs import it as `launch_xml`."""

from bus_launch.launch_xml.entity import Entity
from bus_launch.launch_xml.parser import Parser

__all__ = ["Entity", "Parser"]
