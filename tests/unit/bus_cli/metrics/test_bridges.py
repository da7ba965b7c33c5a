"""bus_cli.metrics.bridges: the counts of bridges become counters that never fall."""

from bus_bridge.core.status import LinkState, RouteState
from bus_cli.bridge.remote import Answer
from bus_cli.metrics.bridges import BridgeTotals, links, waiting

CAMERA = ("/bridge_zenoh", "out", "/camera")


def camera(taken: int, *, gid: str = "aa", sent: int = 0, **dropped: int) -> RouteState:
    return RouteState(topic="/camera", gid=gid, taken=taken, sent=sent, bytes=10 * sent, dropped=dropped)


def seen(*routes: RouteState) -> dict[str, Answer]:
    return {"/bridge_zenoh": Answer(routes=[*routes])}


def test_routes_of_one_topic_are_added_up() -> None:
    totals = BridgeTotals(10)
    totals.take(seen(camera(5, sent=3, replaced=2), camera(7, gid="bb", sent=6, lost_on_the_way=4)))
    assert totals.taken.rows == {CAMERA: 12}
    assert totals.sent.rows == {CAMERA: 9}
    assert totals.bytes.rows == {CAMERA: 90}
    assert totals.lost.rows == {CAMERA: 4}
    assert totals.dropped.rows == {(*CAMERA, "replaced"): 2}


def test_they_go_on_where_a_route_or_a_bridge_goes_and_comes_back() -> None:
    totals = BridgeTotals(10)
    totals.take(seen(camera(5, sent=5)))
    totals.take(seen())
    assert totals.taken.rows == {CAMERA: 5}
    totals.take(seen(camera(6, sent=6)))
    assert totals.taken.rows == {CAMERA: 6}
    totals.take({})
    totals.take(seen(camera(2, sent=1, replaced=1)))  # another process, which begins at 0
    assert totals.taken.rows == {CAMERA: 8}
    assert totals.sent.rows == {CAMERA: 7}
    assert totals.dropped.rows == {(*CAMERA, "replaced"): 1}


def test_refused_connections_go_on_where_a_bridge_comes_back() -> None:
    totals, row = BridgeTotals(10), ("/bridge_zenoh",)
    totals.take({"/bridge_zenoh": Answer(refused=2)})
    assert totals.refused.rows == {row: 2}
    totals.take({})
    totals.take({"/bridge_zenoh": Answer(refused=3)})
    assert totals.refused.rows == {row: 3}
    totals.take({"/bridge_zenoh": Answer(refused=1)})  # another process, which begins at 0
    assert totals.refused.rows == {row: 4}


def test_rows_are_bounded() -> None:
    totals = BridgeTotals(1)
    other = RouteState(topic="/other", gid="bb", taken=1)
    totals.take(seen(camera(1), other))
    assert (totals.taken.rows, totals.taken.left_out) == ({CAMERA: 1}, 1)


def test_what_there_is_now() -> None:
    bridges = {
        "/bridge_zenoh": Answer(
            routes=[RouteState(topic="/a", waiting=2), RouteState(topic="/a", waiting=3)],
            links=[LinkState(state="up"), LinkState(state="up"), LinkState(state="trying")],
        )
    }
    assert waiting(bridges) == {("/bridge_zenoh", "out", "/a"): 5}
    assert links(bridges) == {("/bridge_zenoh", "up"): 2, ("/bridge_zenoh", "trying"): 1}
