"""The topics to play: names, services, regular expressions, and topics that they exclude."""

import pytest

from bus_bag.errors import BagError
from bus_bag.play.selection import Selection

TOPICS = ["/imu", "/tf", "/camera/image", "/add/_service_event"]


@pytest.mark.parametrize(
    ("choice", "played"),
    [
        ({}, TOPICS),
        ({"topics": ["/imu", "tf", "/none"]}, ["/imu", "/tf", "/add/_service_event"]),
        ({"topics": ["/imu"], "services": ["/other"]}, ["/imu"]),
        ({"services": ["add"]}, TOPICS),
        ({"services": ["/sub"]}, TOPICS[:3]),
        ({"regex": "/camera/.*"}, ["/camera/image"]),
        ({"regex": "camera"}, []),
        ({"regex": "/t.*", "topics": ["/imu"]}, ["/imu", "/tf"]),
        ({"exclude_regex": "/[it].*"}, ["/camera/image", "/add/_service_event"]),
        ({"exclude_topics": ["imu"], "exclude_services": ["/add"]}, ["/tf", "/camera/image"]),
        ({"topics": ["/imu", "/tf"], "exclude_topics": ["/imu"]}, ["/tf", "/add/_service_event"]),
        ({"regex": ".*", "exclude_regex": ".*image"}, ["/imu", "/tf", "/add/_service_event"]),
    ],
)
def test_what_is_played(choice: dict[str, str], played: list[str]) -> None:
    selection = Selection(**choice)
    assert [topic for topic in TOPICS if selection.has(topic)] == played


@pytest.mark.parametrize("option", ["regex", "exclude_regex"])
def test_what_is_no_regular_expression(option: str) -> None:
    with pytest.raises(ValueError, match=r"'\(' is not a regular expression: "):
        Selection(**{option: "("})


def test_a_choice_of_nothing_is_a_mistake() -> None:
    topics = ["/a", "/add/_service_event", *(f"/t{number}" for number in range(10))]
    Selection(topics=["/a", "/typo"], services=["/add", "/typo"]).check(topics)
    Selection(topics=["/typo"]).check([])  # an empty bag
    with pytest.raises(BagError, match=r"Nothing to play of /typo: the bag has events of /add$"):
        Selection(services=["/typo"]).check(topics)
    with pytest.raises(BagError, match=r"It has /a, /add/_service_event, /t0, .*, /t7 and 2 more$"):
        Selection(exclude_regex=".*").check(topics)
