"""The addresses at which a participant announces itself, for each range of discovery."""

from bus_bridge.rtps.reach import DiscoveryRange, Reach
from bus_bridge.rtps.sockets import GROUP, discovery_port, multicast_port
from rows import for_each

ETH, PEER, LOOPBACK = "10.0.0.1", "10.0.0.2", "127.0.0.1"
_DOMAIN = 3


@for_each(
    ("host", "peers", "discovery", "machines"),
    [
        (LOOPBACK, (), "SUBNET", [LOOPBACK]),
        (LOOPBACK, (), "LOCALHOST", [LOOPBACK]),
        (LOOPBACK, (), "OFF", []),
        (LOOPBACK, (LOOPBACK, PEER, PEER), "SYSTEM_DEFAULT", [LOOPBACK, PEER]),
        (ETH, (), "SUBNET", [GROUP]),
        (ETH, (PEER,), "SYSTEM_DEFAULT", [GROUP, PEER]),
        (ETH, (), "LOCALHOST", [ETH]),
        (ETH, (PEER,), "LOCALHOST", [ETH, PEER]),
        (ETH, (PEER,), "OFF", []),
    ],
)
def test_called_machines(
    host: str, peers: tuple[str, ...], discovery: DiscoveryRange, machines: list[str]
) -> None:
    reach = Reach(host, peers, discovery)
    called = reach.called(_DOMAIN)
    assert list(dict.fromkeys(address for address, _ in called)) == machines
    assert len(set(called)) == len(called)
    assert reach.has_multicast == (GROUP in machines)
    for machine in machines:
        ports = [port for address, port in called if address == machine]
        if machine == GROUP:
            assert ports == [multicast_port(_DOMAIN)]
        else:
            assert ports == [discovery_port(_DOMAIN, index) for index in range(32)]


def test_with_discovery_servers_only_they_are_called() -> None:
    servers = ((PEER, 11811), (PEER, 11888))
    for discovery in ("SUBNET", "LOCALHOST", "SYSTEM_DEFAULT"):
        reach = Reach(ETH, (PEER,), discovery, servers)
        assert reach.called(_DOMAIN) == servers and not reach.has_multicast
    assert Reach(ETH, (), "OFF", servers).called(_DOMAIN) == ()
