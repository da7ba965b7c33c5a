"""The headers of the native core can be included by a C client: without Python, and in no circle."""

import re
from graphlib import TopologicalSorter
from pathlib import Path

from bus.delivery import ring_size
from bus.shm import headroom, segments
from rows import for_each

SHM = Path(__file__).parents[4] / "clients" / "bus" / "shm"
BINDING = "py.h"


def constant(name: str) -> int:
    """A constant of sizes.h."""
    found = re.search(
        rf"^#define {name} \(?([\w ()<]+?)\)?(?: +/\*.*)?$", (SHM / "sizes.h").read_text(), re.MULTILINE
    )
    assert found, name
    number, _, shift = found[1].replace("UINT64_C(1)", "1").replace("u", "").partition("<<")
    return int(number) << int(shift or 0)


@for_each(
    ("name", "value"),
    [
        ("RING_FIRST_CAPACITY", ring_size.FIRST_CAPACITY),
        ("RING_FIRST_INDEX", ring_size.FIRST_INDEX),
        ("RING_EARLY", ring_size.EARLY),
        ("RING_LAP_MS", ring_size.LAP_S * 1000),
        ("RING_FOR_EVER", ring_size.FOR_EVER),
        ("MEMORY_RESERVE_PART", headroom._RESERVE_PART),
        ("MEMORY_RESERVE_LEAST", headroom._RESERVE_LEAST),
        ("MEMORY_RESERVE_MOST", headroom._RESERVE_MOST),
        ("MEMORY_STEP", segments._STEP_BYTES),
    ],
)
def test_clients_in_c_have_the_sizes_of_the_library(name: str, value: float) -> None:
    assert constant(name) == value


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
    assert {"feed.h", "gates.h", "sizes.h"} <= set(order)
