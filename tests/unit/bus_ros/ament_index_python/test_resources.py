"""The ament index: resources of any type, found as by ROS 2's own index."""

from pathlib import Path

import pytest

from bus_ros import ament_index_python as ament
from bus_ros.ament_index_python.constants import AMENT_PREFIX_PATH_ENV_VAR, RESOURCE_INDEX_SUBFOLDER
from rows import for_each


@pytest.fixture(autouse=True)
def prefixes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, str]:
    for path, text in {
        "one/thing/foo": "hello",
        "one/thing/.hidden": "",
        "one/thing/folder/inside": "",
        "two/thing/foo": "covered",
        "two/thing/bar": "",
        "two/packages/foo": "",
    }.items():
        prefix, _, rest = path.partition("/")
        file = tmp_path / prefix / RESOURCE_INDEX_SUBFOLDER / rest
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    one, two = str(tmp_path / "one"), str(tmp_path / "two")
    monkeypatch.setenv(AMENT_PREFIX_PATH_ENV_VAR, f"{one}:{two}")
    return one, two


def test_resources(prefixes: tuple[str, str]) -> None:
    one, two = prefixes
    assert ament.get_resource("thing", "foo") == ("hello", one)
    assert ament.has_resource("thing", "bar") == two
    assert ament.has_resource("thing", "folder") is False
    assert ament.has_resource("nothing", "foo") is False
    assert ament.get_resources("thing") == {"foo": one, "bar": two}
    assert ament.get_resources("packages")["foo"] == two
    assert ament.get_resources("nothing") == {}
    assert {"thing", "packages"} <= ament.get_resource_types()
    with pytest.raises(LookupError) as caught:
        ament.get_resource("thing", "baz")
    assert str(caught.value) == "Could not find the resource 'baz' of type 'thing'"


def test_packages_without_an_index(prefixes: tuple[str, str]) -> None:
    """Programs read the lists of definitions."""
    shipped = ament.get_package_prefix("std_srvs")
    content, prefix = ament.get_resource("rosidl_interfaces", "std_srvs")
    assert prefix == ament.has_resource("rosidl_interfaces", "std_srvs") == shipped
    assert content.splitlines() == ["srv/Empty.srv", "srv/SetBool.srv", "srv/Trigger.srv"]
    assert ament.get_resources("rosidl_interfaces")["std_srvs"] == shipped
    assert "rosidl_interfaces" in ament.get_resource_types()
    assert ament.has_resource("rosidl_interfaces", "turtle_tf2_py") is False
    assert ament.get_resource("packages", "std_srvs") == ("", shipped)
    assert ament.get_resources("packages")["std_srvs"] == shipped
    assert ament.has_resource("packages", "no_such_package") is False


def test_an_index_comes_first(prefixes: tuple[str, str]) -> None:
    one, _ = prefixes
    folder = Path(one, RESOURCE_INDEX_SUBFOLDER, "rosidl_interfaces")
    folder.mkdir()
    (folder / "std_srvs").write_text("srv/Own.srv")
    assert ament.get_resource("rosidl_interfaces", "std_srvs") == ("srv/Own.srv", one)
    assert ament.get_resources("rosidl_interfaces")["std_srvs"] == one


@for_each(
    ("kind", "name", "error", "text"),
    [
        ("", "foo", AssertionError, "The resource type must not be empty"),
        ("thing", "", AssertionError, "The resource name must not be empty"),
        ("../x", "foo", ament.InvalidResourceTypeNameError, "Resource type '../x' is invalid"),
        ("..", "foo", ament.InvalidResourceTypeNameError, "Resource type '..' is invalid"),
        ("thing", "a/b", ament.InvalidResourceNameError, "Resource name 'a/b' is invalid"),
        ("thing", "a\\b", ament.InvalidResourceNameError, "Resource name 'a\\b' is invalid"),
    ],
)
def test_names_that_are_refused(kind: str, name: str, error: type[Exception], text: str) -> None:
    for ask in (ament.get_resource, ament.has_resource):
        with pytest.raises(error) as caught:
            ask(kind, name)
        assert str(caught.value) == text
