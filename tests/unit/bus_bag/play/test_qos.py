"""The QoS of a topic that is played."""

from msgspec.structs import replace

from bus.qos import MAX_DEPTH, QoSProfile, sensor_data
from bus_bag.play.qos import kept_for_late_joiners, offered_profile

LATCHED = QoSProfile(1, durability="transient_local")


def test_the_recorded_profile_is_offered() -> None:
    assert offered_profile([sensor_data]) == (sensor_data, False)
    assert offered_profile([]) == (QoSProfile(), False)
    deadline = QoSProfile(3, deadline=0.5, liveliness="manual_by_topic", liveliness_lease_duration=2.0)
    assert offered_profile([deadline, deadline]) == (deadline, False)


def test_history_and_lifespan_make_no_difference() -> None:
    others = [QoSProfile(7), QoSProfile(history="keep_all"), QoSProfile(lifespan=1.0)]
    assert offered_profile([QoSProfile(4), *others]) == (QoSProfile(4), False)


def test_what_differs_is_played_with_the_default() -> None:
    for other in (sensor_data, LATCHED, QoSProfile(deadline=1.0), QoSProfile(liveliness="manual_by_topic")):
        assert offered_profile([QoSProfile(4), QoSProfile(4), other]) == (QoSProfile(), True)


def test_one_publisher_keeps_for_late_joiners_what_several_kept() -> None:
    assert offered_profile([LATCHED, LATCHED, replace(LATCHED, depth=3)]) == (
        replace(LATCHED, depth=5),
        False,
    )
    everything = replace(LATCHED, history="keep_all")
    assert offered_profile([LATCHED, everything]) == (everything, False)
    assert kept_for_late_joiners([sensor_data, LATCHED, LATCHED]) == 2
    assert kept_for_late_joiners([sensor_data]) == 0
    assert kept_for_late_joiners([LATCHED, everything]) == MAX_DEPTH
