"""Announced items: their ids, and the next announcements for a client."""

from bus_web.foxglove.advertised import Advertised, Entry


def test_ids_are_given_once() -> None:
    advertised: Advertised[str, float] = Advertised()
    now = {"/x": "one", "/y": "one"}
    assert advertised.missing(now) == ["/x", "/y"]
    assert [advertised.add(name, now[name], 0.5) for name in now] == [1, 2]
    assert (advertised.missing(now), advertised.gone(now)) == ([], [])
    assert advertised.name_of(1) == "/x"
    now = {"/x": "other"}
    assert advertised.gone(now) == ["/x", "/y"]
    assert [advertised.remove(name) for name in advertised.gone(now)] == [1, 2]
    assert advertised.missing(now) == ["/x"]
    assert advertised.add("/x", "other", 1.5) == 3
    assert [advertised.name_of(id) for id in (1, 2, 3)] == [None, None, "/x"]
    assert advertised.entries == {"/x": Entry(3, "other", 1.5)}
