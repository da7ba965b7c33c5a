"""The ids that a client has chosen for its subscriptions."""

from bus_web.foxglove.subscriptions import MOST, Subscriptions


def test_by_id_and_by_topic() -> None:
    subscriptions = Subscriptions()
    assert subscriptions.add(7, "/x") == ""
    assert (subscriptions.id_of("/x"), subscriptions.topic_of(7)) == (7, "/x")
    assert subscriptions.add(7, "/y") == "there is a subscription 7 already"
    assert subscriptions.add(8, "/x") == "/x is subscribed to already"
    assert subscriptions.remove("/x")
    assert not subscriptions.remove("/x")
    assert (subscriptions.id_of("/x"), subscriptions.topic_of(7)) == (None, None)
    assert subscriptions.add(7, "/y") == ""


def test_there_is_a_bound() -> None:
    subscriptions = Subscriptions()
    faults = [subscriptions.add(number, f"/{number}") for number in range(MOST + 1)]
    assert faults == [""] * MOST + [f"a client can have at most {MOST} subscriptions"]
