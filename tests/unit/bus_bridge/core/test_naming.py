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


RENAMED = {"/scan": "/front/scan", "/add": "/sum", "/left": "/right", "/right": "/left", "/map": "/map"}


@for_each(
    "here, wire",
    [
        ("/scan", "/front/scan"),
        ("/add/_request", "/sum/_request"),
        ("/add/_action/send_goal/_reply", "/sum/_action/send_goal/_reply"),
        ("/left", "/right"),
        ("/right", "/left"),
        ("/map", "/map"),
        ("/scanner", "/bot1/scanner"),
        ("/front/scan", "/bot1/front/scan"),
    ],
)
def test_far_names(here: str, wire: str) -> None:
    naming = Naming("/bot1", RENAMED)
    assert naming.topic_to_wire(here) == wire
    assert naming.topic_from_wire(wire) == here


@for_each("wire", ["/bot1/scan", "/bot1/add/_request", "/bot1/map", "/scan"])
def test_a_far_topic_with_the_name_of_a_renamed_one_has_no_name_here(wire: str) -> None:
    assert Naming("/bot1", RENAMED).topic_from_wire(wire) is None


def test_a_name_that_another_topic_has_on_the_far_side() -> None:
    naming = Naming("", RENAMED)
    with pytest.raises(ConfigurationError, match="a rule has '/front/scan' as the far_name of '/scan'"):
        naming.topic_to_wire("/front/scan")
    with pytest.raises(
        ConfigurationError, match=r"with its far_name, the name '/a/_request' has 250 characters"
    ):
        Naming("", {"/a": "/" + "b" * 240}).topic_to_wire("/a/_request")
    naming.namespace_to_wire("/front/scan")  # nodes are not renamed
    assert naming.namespace_from_wire("/front/scan") == "/front/scan"


@given(st.dictionaries(_NAMES, _NAMES), _NAMES, _NAMES)
def test_far_names_are_unique_in_both_directions(names: dict[str, str], namespace: str, topic: str) -> None:
    unique = {here: far for far, here in {far: here for here, far in names.items()}.items()}
    unique = {here: far for here, far in unique.items() if not (here + far).count("_request")}
    naming = Naming(namespace, unique)
    try:
        wire = naming.topic_to_wire(topic)
    except ConfigurationError:
        pass
    else:
        assert naming.topic_from_wire(wire) == topic
    here = naming.topic_from_wire(topic)
    assert here is None or naming.topic_to_wire(here) == topic


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
