from bus_bridge.core.staying import NEVER_S, Retry, Stays


def test_without_the_end_of_a_link_a_publisher_that_has_gone_stays_for_a_moment() -> None:
    stays = Stays()
    assert stays.until("far", 100.0) == 100.5
    assert stays.next_end(100.0) == NEVER_S
    stays.bus_added("far", 100.0)  # the first connection
    assert stays.until("far", 100.0) == 100.5


def test_after_the_end_of_a_link_it_stays_until_the_bus_has_had_time_to_come_back() -> None:
    stays = Stays()
    stays.bus_removed("far", 100.0)
    assert (stays.until("far", 99.9), stays.until("other", 99.9)) == (160.0, 100.4)
    assert stays.next_end(100.0) == 160.0
    assert stays.next_end(160.0) == NEVER_S
    assert stays.until("far", 99.9) == 100.4  # the bus is forgotten


def test_once_the_bus_is_back_it_has_little_time_to_show_it() -> None:
    stays = Stays()
    stays.bus_removed("far", 100.0)
    stays.bus_added("far", 120.0)
    assert stays.until("far", 99.9) == 125.0
    stays.bus_added("far", 130.0)
    assert stays.until("far", 99.9) == 125.0
    stays.bus_removed("far", 124.0)
    stays.bus_added("far", 183.0)
    assert stays.until("far", 99.9) == 184.0
    stays.bus_removed("other", 120.0)
    assert stays.next_end(183.0) == 184.0


def test_what_has_failed_is_tried_again_less_and_less_often() -> None:
    retry = Retry()
    assert retry.at_s == 0.0
    pauses = list[float]()
    for now_s in range(100, 106):
        retry.fail(float(now_s))
        pauses.append(retry.at_s - now_s)
    assert pauses == [1.0, 2.0, 4.0, 4.0, 4.0, 4.0]
    retry.succeed()
    retry.fail(200.0)
    assert (retry.failures, retry.at_s) == (1, 201.0)
    retry.hurry()
    assert (retry.failures, retry.at_s) == (1, 0.0)
