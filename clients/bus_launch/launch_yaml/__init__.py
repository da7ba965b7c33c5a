"""Launch files in YAML; programs import it as `launch_yaml`."""

from bus_launch.launch_yaml.entity import Entity
from bus_launch.launch_yaml.parser import Parser

__all__ = ["Entity", "Parser"]
