import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.errors import ConfigurationError
from bus_bridge.core.naming import Naming
from rows import for_each

_NAMES = st.lists(st.sampled_from(["a", "b", "bot1", "bot", "_request"]), min_size=1, max_size=4).map(
    lambda parts: "/" + "/".join(parts)
)


@for_each(
    "namespace, here, wire",
    [
        ("", "/chatter", "/chatter"),
        ("/", "/chatter", "/chatter"),
        ("/bot1", "/chatter", "/bot1/chatter"),
        ("bot1", "/a/b", "/bot1/a/b"),
        ("/fleet/bot1", "/add/_request", "/fleet/bot1/add/_request"),
    ],
)
def test_topics(namespace: str, here: str, wire: str) -> None:
    naming = Naming(namespace)
    assert naming.topic_to_wire(here) == wire
    assert naming.topic_from_wire(wire) == here


@for_each("wire", ["/chatter", "/bot1", "/bot10/chatter", "/a/bot1/chatter"])
def test_topics_outside_of_the_namespace_have_no_name_here(wire: str) -> None:
    assert Naming("/bot1").topic_from_wire(wire) is None


@for_each(
    "namespace, here, wire",
    [
        ("", "/", "/"),
        ("", "/a", "/a"),
        ("/bot1", "/", "/bot1"),
        ("/bot1", "/a/b", "/bot1/a/b"),
    ],
)
def test_namespaces_of_nodes(namespace: str, here: str, wire: str) -> None:
    naming = Naming(namespace)
    assert naming.namespace_to_wire(here) == wire
    assert naming.namespace_from_wire(wire) == here


@for_each("wire", ["/", "/bot", "/bot10", "/a/bot1"])
def test_nodes_outside_of_the_namespace_have_no_name_here(wire: str) -> None:
    assert Naming("/bot1").namespace_from_wire(wire) is None


@given(_NAMES, _NAMES)
def test_each_name_has_one_on_the_wire_and_back(namespace: str, topic: str) -> None:
    naming = Naming(namespace)
    assert naming.topic_from_wire(naming.topic_to_wire(topic)) == topic
    back = naming.topic_from_wire(topic)
    assert back is None or naming.topic_to_wire(back) == topic
    assert naming.namespace_from_wire(naming.namespace_to_wire(topic)) == topic


def test_names_that_become_too_long() -> None:
    naming = Naming("/bot1")
    naming.topic_to_wire("/" + "a" * 241)
    with pytest.raises(ConfigurationError, match="has 248 characters; it may have 247"):
        naming.topic_to_wire("/" + "a" * 242)
    with pytest.raises(ConfigurationError, match="it may have 245"):
        naming.namespace_to_wire("/" + "a" * 240)


def test_a_namespace_has_to_be_one() -> None:
    with pytest.raises(ConfigurationError, match="Invalid namespace"):
        Naming("/bot 1")
