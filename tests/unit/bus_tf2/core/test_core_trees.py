"""bus_tf2.core._core: the content of a tree while other things happen."""

import os
import subprocess
import sys
from textwrap import dedent
from typing import Any

import pytest

core: Any = pytest.importorskip("bus_tf2.core._core", reason="BUS_NATIVE=no")


def insert(tree: Any, child: str, parent: str) -> None:
    assert tree.insert(child, parent, 5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, "somebody", False) == 0


def test_names_and_frames_fit_each_other_after_there_was_no_memory() -> None:
    memory = pytest.importorskip("_testcapi", reason="this Python has no _testcapi")
    failed = 0
    for skipped in range(20):
        tree = core.FrameTree(10**10)
        memory.set_nomemory(skipped, skipped + 1)
        try:
            insert(tree, "first", "world")
        except MemoryError:
            failed += 1
        finally:
            memory.remove_mem_hooks()
        insert(tree, "second", "other")
        assert ("second", "other", "somebody", 1, 5, 5) in tree.rows()
    assert failed


def test_a_garbage_collection_may_insert_while_rows_are_made() -> None:
    """This once crashed, so it runs in its own process."""
    program = """
        import gc
        from bus_tf2.core._core import FrameTree

        class Garbage:
            def __init__(self):
                self.me = self

            def __del__(self):
                if keeps_on:
                    insert()
                    Garbage()

        def insert():
            global times
            times += 1
            authority = f"the {times}. " * 50
            tree.insert("child", "world", times, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, authority, False)

        gc.disable()
        tree, times, keeps_on = FrameTree(10**10), 0, True
        insert()
        Garbage()
        gc.set_threshold(1)
        gc.enable()
        kept = [tree.rows() for _ in range(1000)]
        keeps_on = False
        assert all(row[2].startswith("the ") for rows in kept for row in rows)
    """
    environment = {**os.environ, "PYTHONMALLOC": "debug"}  # so that the test sees the use of freed memory
    subprocess.run([sys.executable, "-c", dedent(program)], check=True, timeout=60, env=environment)
