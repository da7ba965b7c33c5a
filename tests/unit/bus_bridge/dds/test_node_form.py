"""The form in which our nodes are listed, by the participants found."""

from bus_bridge.dds.graph import GID_SIZE, HUMBLE_GID_SIZE
from bus_bridge.dds.node_form import NodeForm
from bus_bridge.dds.options import Distro
from rows import for_each

NEW, OLD = GID_SIZE, HUMBLE_GID_SIZE


@for_each(
    ("distro", "found", "size", "warnings"),
    [
        ("auto", [], NEW, 0),
        ("auto", [NEW], NEW, 0),
        ("auto", [OLD, OLD], OLD, 0),
        ("auto", [OLD, NEW], NEW, 1),
        ("auto", [NEW, OLD], NEW, 1),
        ("humble", [NEW], OLD, 0),
    ],
)
def test_forms(distro: Distro, found: list[int], size: int, warnings: int) -> None:
    warned: list[str] = []
    form = NodeForm(distro, warned.append)
    before = form.size
    for number, one in enumerate(found, 1):
        changed = form.follow(one, found[:number])
        assert changed == (form.size != before)
        before = form.size
    assert (form.size, len(warned)) == (size, warnings)
