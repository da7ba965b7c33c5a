"""bus_cli.bridge.status: a bridge's report on itself, as text."""

from bus_bridge.core.status import LinkState, MirrorCounts, RouteState
from bus_cli.bridge.remote import Answer
from bus_cli.bridge.status import lines
from rows import for_each

CAMERA = RouteState(
    topic="/camera/image_raw",
    node="/camera",
    taken=1000,
    sent=990,
    dropped={"replaced": 8, "rate": 2},
    is_flowing=True,
)
COMMANDS = RouteState(
    topic="/cmd_vel",
    direction="in",
    node="/teleop",
    bus="laptop-89abcdef",
    taken=12,
    sent=12,
    dropped={"lost_on_the_way": 3},
)
IDLE = RouteState(topic="/imu", node="/imu")
STATUS = Answer(
    engine="zenoh",
    bus="robot-1a2b3c4d",
    namespace="/bot1",
    uptime_s=192.7,
    links=[
        LinkState(address="tls/10.0.0.9:7447", state="trying", text="connection refused"),
        LinkState(address="tls/10.0.0.2:7447", state="up", bus="laptop-89abcdef"),
    ],
    shown_here=MirrorCounts(nodes=5, publishers=12, subscriptions=8),
    shown_there=MirrorCounts(nodes=3, publishers=4, subscriptions=2),
    routes=[COMMANDS, IDLE, CAMERA],
)
TEXT = """\
/bridge_zenoh: zenoh, this bus is robot-1a2b3c4d, namespace /bot1, up 3 min 12 s
             nodes  publishers  subscriptions
shown here       5          12              8
shown there      3           4              2

up       tls/10.0.0.2:7447  laptop-89abcdef
trying   tls/10.0.0.9:7447  connection refused

way       taken        sent  waiting   dropped      lost  topic
===============================================================================
out        1000         990        0        10         0  /camera/image_raw
     dropped: rate: 2, replaced: 8
in           12          12        0         0         3  /cmd_vel

and 1 route without a subscription (-v shows them)"""


def text(status: Answer, *, is_verbose: bool = False) -> str:
    return "\n".join(lines("/bridge_zenoh", status, is_verbose=is_verbose))


def test_a_bridge() -> None:
    assert text(STATUS) == TEXT
    assert max(map(len, TEXT.splitlines())) <= 80


def test_each_route_apart() -> None:
    shown = text(STATUS, is_verbose=True)
    assert "     of /teleop on laptop-89abcdef\n" in shown
    assert shown.endswith("out           0           0        0         0         0  /imu\n     of /imu")


def test_one_topic_of_several_publishers_is_one_row() -> None:
    other = RouteState(topic="/camera/image_raw", node="/other", taken=1, sent=1, dropped={"replaced": 1})
    shown = text(Answer(routes=[CAMERA, other]))
    assert "out        1001         991        0        11         0  /camera/image_raw\n" in shown
    assert shown.endswith("     dropped: rate: 2, replaced: 9")


def test_a_loss_that_can_not_be_counted_is_not_said_to_be_none() -> None:
    of_ros = RouteState(topic="/scan", direction="in", taken=5, sent=5, counts_lost=False)
    shown = text(Answer(routes=[CAMERA, of_ros]))
    assert "in            5           5        0         0         -  /scan\n" in shown
    assert shown.endswith("\n\nlost -: not counted, because DDS shows no numbers of messages")
    assert "DDS" not in text(Answer(routes=[CAMERA, COMMANDS]))


def test_what_is_wrong_is_said() -> None:
    stuck = RouteState(topic="/a", waiting=7, is_flowing=True, is_stuck=True)
    shown = text(Answer(routes=[stuck], repeated=2))
    assert "stuck: messages wait" in shown
    assert "dropped because they came twice: 2 messages\n" in shown
    assert "came twice: 1 message\n" in text(Answer(repeated=1))
    assert "no link\n" in shown


@for_each(
    ("seconds", "said"),
    [(0.0, "up 0 s"), (59.9, "up 59 s"), (60.0, "up 1 min 0 s"), (7384.0, "up 2 h 3 min")],
)
def test_durations(seconds: float, said: str) -> None:
    assert text(Answer(uptime_s=seconds)).splitlines()[0].endswith(said)
