"""launch_testing_ros.wait_for_topics: which messages it waits for and keeps, without a node."""

import pytest

from bus_launch.launch_testing_ros.wait_for_topics import WaitForTopics


@pytest.fixture
def topics(monkeypatch: pytest.MonkeyPatch) -> WaitForTopics:
    made = WaitForTopics([("a", str), ("b", str)], timeout=0.01, messages_received_buffer_length=2)
    monkeypatch.setattr(made, "_start", lambda: None)
    return made


def test_each_topic_must_have_a_message(topics: WaitForTopics) -> None:
    assert not topics.wait()
    topics._callback_for("a")("first")
    assert not topics.wait()
    assert (topics.topics_received(), topics.topics_not_received()) == ({"a"}, {"b"})
    with pytest.raises(RuntimeError, match=r"Did not receive messages on these topics: \{'b'\}"):
        topics.__enter__()
    topics._callback_for("b")("second")
    with topics as entered:
        assert entered.wait() and not entered.topics_not_received()


def test_the_newest_messages_are_kept(topics: WaitForTopics) -> None:
    for number in range(5):
        topics._callback_for("a")(number)
    assert topics.received_messages("a") == [3, 4]
    assert topics.received_messages("b") == []
    with pytest.raises(KeyError):
        topics.received_messages("c")
