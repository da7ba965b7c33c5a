"""The headers of the native core can be included by a C client: without Python, and in no circle."""

import re
from graphlib import TopologicalSorter
from pathlib import Path

SHM = Path(__file__).parents[4] / "clients" / "bus" / "shm"
BINDING = "py.h"


def test_only_the_binding_needs_python() -> None:
    assert [path.name for path in SHM.glob("*.h") if "Python.h" in path.read_text()] == [BINDING]


def test_no_header_includes_itself_by_way_of_others() -> None:
    includes = {
        path.name: set(re.findall(r'^#include "(\w+\.h)"', path.read_text(), re.MULTILINE))
        for path in SHM.glob("*.h")
    }
    order = list(TopologicalSorter(includes).static_order())
    assert order.index(BINDING) > order.index("feed.h")
    assert set(order[order.index(BINDING) + 1 :]) == {"py_plan.h"}
    assert {"feed.h", "gates.h"} <= set(order)
