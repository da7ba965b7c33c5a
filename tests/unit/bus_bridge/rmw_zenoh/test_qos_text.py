"""bus_bridge.rmw_zenoh.qos_text: texts as pyzeros writes them."""

from bus.qos import QoSProfile
from bus_bridge.rmw_zenoh import qos_text
from rows import for_each

TEXTS = [
    (QoSProfile(), "::,10:,:,:,,"),
    (QoSProfile(42), "::,:,:,:,,"),
    (QoSProfile(1, reliability="best_effort", durability="transient_local"), "2:1:,1:,:,:,,"),
    (QoSProfile(0, history="keep_all"), "::2,:,:,:,,"),
    (
        QoSProfile(deadline=0.5, lifespan=2.25, liveliness_lease_duration=3),
        "::,10:0,500000000:2,250000000:,3,0",
    ),
]


@for_each(("qos", "text"), TEXTS)
def test_both_ways(qos: QoSProfile, text: str) -> None:
    assert qos_text.write(qos) == text
    assert qos_text.read(text) == qos


def test_manual_liveliness_is_only_read() -> None:
    manual = QoSProfile(liveliness="manual_by_topic")
    assert qos_text.read("::,10:,:,:3,,") == manual
    assert qos_text.write(manual) == "::,10:,:,:,,"


@for_each(
    ("text", "qos"),
    [
        ("4:4:3,0:0,0:9223372036,854775807:5,,", QoSProfile(42)),  # unknown policies, and infinite durations
        ("::,99999999999999999999:,:,:,,", QoSProfile(2**31 - 1)),
        ("::,10:1,:,5:,,", QoSProfile(deadline=1.0, lifespan=5e-9)),
    ],
)
def test_unusual_numbers(text: str, qos: QoSProfile) -> None:
    assert qos_text.read(text) == qos


@for_each(
    "text",
    ["", "::,10", "::,10:,:,:,", "a:::,10:,:,:,,", "::,-1:,:,:,,", "::,10:,:,:,,:", "::,\u0661:,:,:,,"],
)
def test_what_is_no_profile(text: str) -> None:
    assert qos_text.read(text) is None
