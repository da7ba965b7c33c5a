"""bus.link: lists of nodes and links, read while other threads make new ones."""

import sys
from types import FrameType
from typing import Any
from weakref import WeakKeyDictionary

from bus.link.declarations import Declarations
from bus.link.link import Link


class _Switches:
    """Lets `make` run at each line of Python's and the bus's code at which another thread could run."""

    def __init__(self, make: Any) -> None:
        self._make = make
        self.made: list[Any] = []

    def __enter__(self) -> None:
        self._before = sys.gettrace()
        sys.settrace(self._line)

    def __exit__(self, *_: object) -> None:
        sys.settrace(self._before)

    def _line(self, frame: FrameType, event: str, argument: object) -> Any:
        self.made.append(self._make())
        return self._line


class _Node:
    pass


def test_nodes() -> None:
    declarations = Declarations(int)

    def make() -> Any:
        node: Any = _Node()
        declarations._nodes[node] = WeakKeyDictionary()
        return node

    first = make()
    switches = _Switches(make)
    with switches:
        nodes = declarations.nodes
    assert nodes[0] is first
    assert set(nodes) <= {first, *switches.made}
    assert declarations.nodes == [first, *switches.made]


def test_links() -> None:
    before = Link.all()

    def make() -> Link:
        link = Link.__new__(Link)
        Link._links[id(link)] = link
        return link

    first = make()
    switches = _Switches(make)
    with switches:
        links = Link.all()
    assert links[: len(before) + 1] == [*before, first]
    assert Link.all() == [*before, first, *switches.made]
