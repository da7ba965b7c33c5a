import pytest

from bus.base.suggest import did_you_mean, nearest

NEAR = [
    ("publsher.py", "publisher.py"),
    ("pubilsher.py", "publisher.py"),
    ("minimal_publsher.py", "minimal_publisher.py"),
    ("Publisher.py", "publisher.py"),
    ("sub/lisener.py", "sub/listener.py"),
    ("talker", "talker.py"),
    ("/chatter", "/robot/chatter"),
    ("/robot/camra/image", "/robot/camera/image"),
    ("sensordata", "sensor_data"),
    ("maxdepth", "max_depth"),
    ("max_rate", "max_rate_hz"),
    ("std_msg/msg/String", "std_msgs/msg/String"),
    ("std_msgs/msg/Strng", "std_msgs/msg/String"),
    ("lsit", "list"),
    ("flaot64", "float64"),
    ("sek", "sec"),
]
FAR = [
    ("publsher.py", "subscriber.py"),
    ("publisher.py", "subscriber.py"),
    ("minimal_publsher.py", "minimal_subscriber.py"),
    ("minimal_publisher_function.py", "minimal_subscriber_function.py"),
    ("talker.py", "teleop.py"),
    ("listener.py", "latency.py"),
    ("camera_driver.py", "lidar_driver.py"),
    ("sensor_msgs/msg/Image", "sensor_msgs/msg/Range"),
    ("/robot/left/image", "/robot/right/image"),
    ("std_msgs/msg/Int32", "std_msgs/msg/Empty"),
    ("start.py", "main.py"),
    ("/camera/image_raw", "/camera/camera_info"),
]


@pytest.mark.parametrize(("typed", "meant"), NEAR)
def test_a_slip_finds_what_was_meant(typed: str, meant: str) -> None:
    assert nearest(typed, [meant, "zzz", *(far for _, far in FAR if far != meant)]) == meant


@pytest.mark.parametrize(("typed", "other"), FAR)
def test_another_name_is_not_offered(typed: str, other: str) -> None:
    assert nearest(typed, [other]) is None
    assert did_you_mean(typed, [other]) == ""


def test_a_far_name_that_is_most_alike_does_not_hide_a_near_one() -> None:
    among = ["minimal_subscriber.py", "minimal_publisher.py", "minimal_publishers_test.py"]
    assert nearest("minimal_publsher.py", among) == "minimal_publisher.py"


def test_the_end_of_a_text() -> None:
    assert did_you_mean("talkr", ["talker", "listener"]) == "; did you mean 'talker'?"
