"""bus_launch.launch_ros.namespaces: names joined to namespaces."""

from bus_launch.launch_ros.namespaces import (
    is_namespace_absolute,
    is_root_namespace,
    make_namespace_absolute,
    prefix_namespace,
)
from rows import for_each


@for_each(
    ("base", "namespace", "expected"),
    [
        (None, None, None),
        ("", None, ""),
        ("", "b/", "b"),
        (None, "/b/", "/b"),
        ("/a", None, "/a"),
        (None, "b", "b"),
        ("/a", "b", "/a/b"),
        ("/a/", "b/", "/a/b"),
        ("/", "b", "/b"),
        ("/a", "/b", "/b"),
        ("/a", "", "/a"),
        ("/", "", "/"),
    ],
)
def test_a_namespace_in_another(base: str | None, namespace: str | None, expected: str | None) -> None:
    assert prefix_namespace(base, namespace) == expected


def test_which_are_absolute() -> None:
    assert [make_namespace_absolute(one) for one in (None, "", "a", "/a/", "a/b")] == [
        "/",
        "/",
        "/a",
        "/a",
        "/a/b",
    ]
    assert [is_namespace_absolute(one) for one in ("/", "/a", "a")] == [True, True, False]
    assert [is_root_namespace(one) for one in ("/", "/a")] == [True, False]
