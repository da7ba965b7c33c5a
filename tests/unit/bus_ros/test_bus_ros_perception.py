"""docs/perception.md: all names in its lists exist, and its lists have all names that exist."""

import re
from importlib import import_module
from pathlib import Path

from rows import for_each

TEXT = (Path(__file__).parents[3] / "docs" / "perception.md").read_text()
TABLE = TEXT.partition("## Modules")[2].partition("\n## ")[0]
MODULES = dict(re.findall(r"^\| `([\w.]+)` \| (.*) \|$", TABLE, re.M))


@for_each("name", MODULES)
def test_a_module(name: str) -> None:
    module = import_module(f"bus_ros.{name}")
    listed = set(re.findall(r"`(\w+)`", MODULES[name]))
    assert set(module.__all__) == listed
    assert not [one for one in listed if not hasattr(module, one)]
