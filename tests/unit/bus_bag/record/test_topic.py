"""One recorded topic: the bound of its queued messages, and the publishers' profiles that it remembers."""

from typing import Any

from bus.msg.geometry_msgs import Twist
from bus.msg.sensor_msgs import Image, LaserScan
from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.types.classes import message_class
from bus_bag.record.choice import Found
from bus_bag.record.topic import RecordedTopic, profile_for
from rows import for_each

LATCHED = QoSProfile(1, durability="transient_local")


def test_a_profile_counts_as_often_as_there_were_publishers_with_it_at_one_time() -> None:
    schema = MessageSchema.of(String)
    topic = RecordedTopic(Found("/tf_static", schema.type_name, schema.type_hash), schema)
    for offers in ([QoSProfile(), LATCHED], [LATCHED], [LATCHED, LATCHED], [], [LATCHED, LATCHED]):
        topic.update_offers(offers)
        assert topic.is_latched
    assert topic.metadata.offered_qos_profiles == (QoSProfile(), LATCHED, LATCHED)


@for_each(
    ("message_type", "depth"),
    [
        (Twist, 1000),
        (message_class("tf2_msgs/msg/TFMessage"), 1000),
        (LaserScan, 200),
        (Image, 20),
    ],
)
def test_how_much_may_wait(message_type: Any, depth: int) -> None:
    assert profile_for(MessageSchema.of(message_type)) == QoSProfile(
        depth, reliability="best_effort", durability="best_available"
    )
