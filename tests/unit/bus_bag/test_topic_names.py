"""Names as users type them, and the topics of services' events."""

import pytest

from bus.errors import ConfigurationError
from bus_bag.topic_names import absolute_names, compiled, event_topics, is_event_topic


def test_names_are_of_the_root_namespace() -> None:
    assert absolute_names(["scan", "/scan", "/a/b"]) == {"/scan", "/a/b"}
    assert event_topics(["add"]) == {"/add/_service_event"}


@pytest.mark.parametrize(
    ("topic", "types", "is_event"),
    [
        ("/add/_service_event", {"demo/srv/Add_Event"}, True),
        ("/add/_service_event", {"demo/msg/Add_Event"}, False),
        ("/add/_service_event", {"demo/srv/Add_Event", "demo/msg/Own"}, False),
        ("/add", {"demo/srv/Add_Event"}, False),
    ],
)
def test_events_of_a_service(topic: str, types: set[str], is_event: bool) -> None:
    assert is_event_topic(topic, types) is is_event


def test_regular_expressions() -> None:
    assert compiled("") is None
    with pytest.raises(ConfigurationError, match=r"'\(' is not a regular expression: missing \)"):
        compiled("(")
