"""The server looks at a topic as long as there is a reason."""

from typing import Any

from bus_web.foxglove.looks import Looks


class Subscriptions:
    """Records its calls."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def add(self, topic: str, listener: Any, *, is_last_wanted: bool) -> None:
        assert not is_last_wanted, "a recorder must not get old messages as new ones"
        self.asked.append(f"+{topic}")

    def remove(self, topic: str, listener: Any) -> None:
        self.asked.append(f"-{topic}")


def test_from_the_first_reason_to_the_last() -> None:
    subscriptions: Any = Subscriptions()
    looks = Looks(subscriptions, object())  # type: ignore[arg-type]
    for topic, reason in (("/clock", "time"), ("/clock", "messages"), ("/x", "messages"), ("/x", "messages")):
        looks.add(topic, reason)
    assert subscriptions.asked == ["+/clock", "+/x"]
    looks.remove("/clock", "time")
    looks.remove("/clock", "parameters")
    looks.remove("/nothing", "time")
    assert subscriptions.asked == ["+/clock", "+/x"]
    looks.remove("/clock", "messages")
    assert subscriptions.asked[2:] == ["-/clock"]
    looks.close()
    looks.close()
    assert subscriptions.asked[3:] == ["-/x"]
