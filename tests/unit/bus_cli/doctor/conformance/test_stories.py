"""The number with which a publisher may continue at another busd."""

from bus.msg.std_msgs import String
from bus.qos import QoSProfile
from bus.schema import MessageSchema
from bus.types.support import type_support
from bus_cli.doctor.conformance.conversation import Endpoint
from bus_cli.doctor.conformance.stories import least_next_seq
from rows import for_each

SUPPORT = type_support(String)
SCHEMA = MessageSchema(SUPPORT.name, SUPPORT.hash, SUPPORT.description)


@for_each(
    ("qos", "last_seq", "least"),
    [
        (QoSProfile(10), 7, 8),
        (QoSProfile(history="keep_all"), 7, 8),
        (QoSProfile(3, durability="transient_local"), 7, 5),
        (QoSProfile(10, durability="transient_local"), 7, 1),
        (QoSProfile(history="keep_all", durability="transient_local"), 7, 1),
    ],
)
def test_next_seq(qos: QoSProfile, last_seq: int, least: int) -> None:
    publisher = Endpoint(
        id=42,
        is_publisher=True,
        topic="/topic",
        schema=SCHEMA,
        qos=qos,
        gid=bytes(16),
        node=41,
        partner=43,
        last_seq=last_seq,
    )
    assert least_next_seq(publisher) == least
