"""Sockets of participants: their ports, and what is said if there is none."""

import socket

import pytest

from bus_bridge.errors import BridgeError
from bus_bridge.rtps.parameters import Address
from bus_bridge.rtps.sockets import Sockets, discovery_port, multicast_port
from ports import own_domain

DOMAIN = own_domain()
HOST = "127.0.0.1"


def test_ports() -> None:
    assert (multicast_port(0), discovery_port(0, 0), discovery_port(2, 3)) == (7400, 7410, 7916)


def test_each_participant_has_its_port() -> None:
    one, two = (Sockets(DOMAIN, HOST, multicast=False) for _ in range(2))
    try:
        assert one.address[1] < two.address[1]
        one.send(two.address, b"hello")
        got: list[tuple[bytes, Address]] = []
        two.receive(two.descriptors[0], lambda data, source: got.append((data, source)))
        assert got == [(b"hello", one.address)]
        one.send((HOST, 0), b"nowhere")
        assert one.dropped == 1
    finally:
        one.close()
        two.close()


def test_an_address_of_another_machine() -> None:
    with pytest.raises(BridgeError, match=r"can't receive at 198\.51\.100\.1:\d+: Cannot assign"):
        Sockets(DOMAIN, "198.51.100.1", multicast=False)


def test_all_ports_are_taken() -> None:
    held = []
    try:
        for index in range(100):
            one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            held.append(one)
            try:
                one.bind((HOST, discovery_port(DOMAIN, index)))
            except OSError:
                pass  # another program has it
        with pytest.raises(BridgeError, match="all 100 ports"):
            Sockets(DOMAIN, HOST, multicast=False)
    finally:
        for one in held:
            one.close()
