"""Which address of a participant is used."""

from bus_bridge.rtps.far import choose_address
from bus_bridge.rtps.parameters import Address
from rows import for_each

LAN, WIFI = ("10.0.0.5", 7411), ("192.0.2.5", 7411)


@for_each(
    "addresses, source, chosen",
    [
        ((LAN, WIFI), ("192.0.2.5", 40000), WIFI),
        ((LAN, WIFI), ("192.0.2.9", 40000), LAN),
        ((LAN, WIFI), ("127.0.0.1", 40000), ("127.0.0.1", 7411)),
        ((), ("127.0.0.1", 40000), None),
    ],
)
def test_addresses(addresses: tuple[Address, ...], source: Address, chosen: Address | None) -> None:
    assert choose_address(addresses, source) == chosen
