"""TCP sockets of this process that shall not linger: all of them, and nothing else is touched."""

import socket
import struct

import pytest

from bus_bridge.zenoh.lingering import close_at_once
from conftest import open_descriptors

_LINGERS = struct.pack("ii", 1, 10)


def lingers(one: socket.socket) -> bool:
    return bool(one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER))


@pytest.mark.parametrize("family", [socket.AF_INET, socket.AF_INET6])
def test_tcp_sockets_close_at_once_afterwards_and_stay_open(family: socket.AddressFamily) -> None:
    host = "127.0.0.1" if family == socket.AF_INET else "::1"
    with socket.create_server((host, 0), family=family) as server, socket.socket(family) as one:
        one.connect(server.getsockname())
        other, _ = server.accept()
        with other:
            for end in (one, other):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGERS)
                assert lingers(end)
            before = open_descriptors()
            close_at_once()
            assert open_descriptors() == before
            assert not lingers(one) and not lingers(other)
            one.sendall(b"still there")
            assert other.recv(100) == b"still there"


def test_sockets_that_are_no_tcp_stay_as_they_are() -> None:
    one, other = socket.socketpair()
    with one, other:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGERS)
        close_at_once()
        assert lingers(one)
        one.sendall(b"still there")
        assert other.recv(100) == b"still there"
