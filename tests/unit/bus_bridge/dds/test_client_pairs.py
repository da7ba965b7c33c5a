"""bus_bridge.dds.client_pairs: a far client's writer is reported after its reader."""

from bus.qos import QoSProfile
from bus_bridge.dds.client_pairs import ClientPairs
from bus_bridge.dds.graph import Found
from bus_bridge.engine import EndpointKind, FarEndpoint

ONE, OTHER = b"p" * 16, b"q" * 16


def found(kind: EndpointKind, gid: str, participant: bytes = ONE) -> Found:
    return Found(participant, FarEndpoint(kind, gid.encode(), "", "/topic", "", "", QoSProfile(10)))


def names(found: list[Found]) -> list[str]:
    return [one.endpoint.gid.decode() for one in found]


def test_a_reader_comes_first() -> None:
    pairs = ClientPairs()
    assert names(pairs.added(found("subscription", "reader"), "/s")) == ["reader"]
    assert names(pairs.added(found("publisher", "writer"), "/s")) == ["writer"]


def test_a_writer_waits_for_its_reader() -> None:
    pairs = ClientPairs()
    assert pairs.added(found("publisher", "first"), "/s") == []
    assert pairs.added(found("publisher", "second"), "/s") == []
    for reader in (("one", "/other", ONE), ("two", "/s", OTHER)):
        gid, service, participant = reader
        assert names(pairs.added(found("subscription", gid, participant), service)) == [gid]
    assert names(pairs.added(found("subscription", "three"), "/s")) == ["three", "first"]
    assert names(pairs.added(found("subscription", "four"), "/s")) == ["four", "second"]


def test_what_goes_is_forgotten() -> None:
    pairs = ClientPairs()
    pairs.added(found("publisher", "gone"), "/s")
    pairs.removed(b"gone")
    pairs.removed(b"unknown")
    assert names(pairs.added(found("subscription", "reader"), "/s")) == ["reader"]
    pairs.removed(b"reader")
    assert pairs.added(found("publisher", "writer"), "/s") == []
    pairs.removed(b"writer")
    assert not pairs._clients and not pairs._keys


def test_an_endpoint_that_is_described_again() -> None:
    pairs = ClientPairs()
    for _ in range(2):
        assert names(pairs.added(found("subscription", "reader"), "/s")) == ["reader"]
        assert names(pairs.added(found("publisher", "writer"), "/s")) == ["writer"]
