"""A recorded topic: which profiles of publishers it remembers."""

from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus_bag.record.choice import Found
from bus_bag.record.topic import RecordedTopic

LATCHED = QoSProfile(1, durability="transient_local")


def test_a_profile_counts_as_often_as_there_were_publishers_with_it_at_one_time() -> None:
    schema = MessageSchema.of(String)
    topic = RecordedTopic(Found("/tf_static", schema.type_name, schema.type_hash), schema)
    assert topic.meet([QoSProfile(), LATCHED]) and topic.is_latched
    assert not topic.meet([LATCHED])
    assert topic.meet([LATCHED, LATCHED])
    assert not topic.meet([]) and not topic.meet([LATCHED, LATCHED]) and topic.is_latched
    assert topic.metadata.offered_qos_profiles == (QoSProfile(), LATCHED, LATCHED)
