"""The native core of transforms against its Python twin: the same results, and the same errors."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bus_tf2.core import twin
from effort import examples

core = pytest.importorskip("bus_tf2.core._core", reason="BUS_NATIVE=no")

NAMES = ("a", "b", "c", "d", "e")
name = st.sampled_from(NAMES)
part = st.sampled_from((0.0, 1.0, -1.0, 0.5, 2.0, -0.25))
number = st.one_of(part, st.floats(-1e6, 1e6))
quaternion = st.one_of(
    st.tuples(part, part, part, part),
    st.tuples(number, number, number, number),
    st.sampled_from(((0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 1.0))),
)
place = st.tuples(st.one_of(number, st.just(math.nan)), number, number)
stamp = st.one_of(st.integers(0, 12), st.sampled_from((-(1 << 63), (1 << 63) - 1, 1_700_000_000_000_000_000)))
insertion = st.tuples(name, name, stamp, place, quaternion, st.sampled_from((False, False, False, True)))
look = st.tuples(st.sampled_from((*NAMES, "nobody")), name, stamp)


def same(a: Any, b: Any) -> bool:
    if not isinstance(a, tuple) or len(a) == 3:
        return bool(a == b)
    return bool(a[0] == b[0] and b[1:] == pytest.approx(a[1:], rel=1e-9, abs=1e-9, nan_ok=True))


def of_both(trees: list[Any], method: str, *arguments: Any) -> Any:
    native, plain = (getattr(tree, method)(*arguments) for tree in trees)
    assert same(native, plain), (method, arguments, native, plain)
    return native


@settings(max_examples=examples(300))
@given(
    st.sampled_from((0, 3, 10, (1 << 63) - 1)),
    st.lists(st.one_of(insertion, look, st.just(None)), min_size=3, max_size=40),
)
def test_same_answers(cache_ns: int, deeds: list[Any]) -> None:
    trees: list[Any] = [core.FrameTree(cache_ns), twin.FrameTree(cache_ns)]
    for index, deed in enumerate(deeds):
        if deed is None:
            of_both(trees, "clear")
        elif len(deed) == 3:
            of_both(trees, "lookup", *deed)
            of_both(trees, "latest", *deed[:2])
            of_both(trees, "parent", deed[1], deed[2])
        else:
            child, parent, stamp_ns, moved, turned, is_static = deed
            of_both(trees, "insert", child, parent, stamp_ns, *moved, *turned, f"who{index}", is_static)
    of_both(trees, "rows")
    for target in of_both(trees, "names"):
        for source in NAMES:
            for time_ns in (0, 5):
                of_both(trees, "lookup", target, source, time_ns)


def test_a_loop_ends() -> None:
    trees: list[Any] = [core.FrameTree(100), twin.FrameTree(100)]
    for child, parent in (("a", "b"), ("b", "c"), ("c", "a"), ("d", "c")):
        of_both(trees, "insert", child, parent, 1, 0, 0, 0, 0, 0, 0, 1, "", False)
    for time_ns in (0, 1):
        assert of_both(trees, "lookup", "elsewhere", "d", time_ns) == (twin.UNKNOWN, 0, 0)
    of_both(trees, "insert", "x", "y", 1, 0, 0, 0, 0, 0, 0, 1, "", False)
    for time_ns in (0, 1):
        assert of_both(trees, "lookup", "x", "d", time_ns) == (twin.LOOP, 0, 0)
        assert of_both(trees, "lookup", "d", "x", time_ns)[0] == twin.LOOP


def test_a_deep_tree() -> None:
    """A path may have a thousand steps; with more, it counts as a loop."""
    trees: list[Any] = [core.FrameTree(100), twin.FrameTree(100)]
    for number in range(1005):
        of_both(trees, "insert", f"f{number}", f"f{number + 1}", 1, 1, 0, 0, 0, 0, 0, 1, "", False)
    for time_ns in (0, 1):
        for steps in (999, 1000, 1001, 1002, 1003):
            of_both(trees, "lookup", f"f{steps}", "f0", time_ns)
            of_both(trees, "lookup", "f0", f"f{steps}", time_ns)
        assert of_both(trees, "lookup", "f1000", "f0", time_ns)[1] == 1000.0


def test_the_bound_of_one_frame() -> None:
    """If transforms arrive faster than they expire, the oldest are dropped."""
    trees: list[Any] = [core.FrameTree(10**18), twin.FrameTree(10**18)]
    most = twin.MAX_SAMPLES
    for number in range(most + 10):
        for tree in trees:
            tree.insert("a", "b", number + 1, number, 0, 0, 0, 0, 0, 1, "", False)
    [row] = of_both(trees, "rows")
    assert row[3:] == (most, most + 10, 11)
    of_both(trees, "insert", "a", "b", 5, 0, 0, 0, 0, 0, 0, 1, "", False)
    assert of_both(trees, "lookup", "b", "a", 11)[1] == 10.0
    assert of_both(trees, "lookup", "b", "a", 10) == (twin.PAST, 10, 11)


@pytest.mark.parametrize(
    ("method", "arguments"),
    [
        ("lookup", ("a", "b")),
        ("lookup", (1, "b", 0)),
        ("lookup", ("a", "b", "c")),
        ("parent", ("a", 1 << 80)),
    ],
)
def test_wrong_arguments(method: str, arguments: tuple[Any, ...]) -> None:
    with pytest.raises((TypeError, OverflowError)):
        getattr(core.FrameTree(1), method)(*arguments)
