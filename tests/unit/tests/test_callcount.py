"""The counter of calls."""

import gc
from typing import Any

from callcount import CallCounter

_MODULE = """
class Circle:
    def __init__(self):
        self.me = self  # only a collection removes it

    def __del__(self):
        pass
"""


def test_finalizers_that_a_collection_calls_do_not_count() -> None:
    module: dict[str, Any] = {"__name__": "product"}  # calls in tests do not count
    exec(_MODULE, module)
    before = gc.get_threshold()
    module["Circle"]()
    kept: list[list[int]] = []
    with CallCounter() as counter:
        gc.set_threshold(1)
        kept.extend([] for _ in range(100))  # this causes a collection if the collector is enabled
    gc.set_threshold(*before)
    assert "Circle.__del__" not in {function for _, function in counter.calls}
    assert gc.isenabled()
