"""TCP sockets of this process time out. This is true for all of them, and for no other socket."""

import os
import socket
import struct

import pytest

from bus_bridge.zenoh.sockets import give_up_in_time, tcp_sockets
from conftest import open_descriptors

_LINGERS = struct.pack("ii", 1, 10)


def lingers(one: socket.socket) -> bool:
    return bool(one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER))


@pytest.mark.parametrize("family", [socket.AF_INET, socket.AF_INET6])
def test_tcp_sockets_give_up_in_time_afterwards_and_stay_open(family: socket.AddressFamily) -> None:
    host = "127.0.0.1" if family == socket.AF_INET else "::1"
    with socket.create_server((host, 0), family=family) as server, socket.socket(family) as one:
        one.connect(server.getsockname())
        other, _ = server.accept()
        with other:
            for end in (one, other):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGERS)
                assert lingers(end)
            before = open_descriptors()
            give_up_in_time(1234)
            assert open_descriptors() == before
            for end in (one, other):
                assert not lingers(end)
                assert end.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 1234
            one.sendall(b"still there")
            assert other.recv(100) == b"still there"


def test_sockets_that_are_no_tcp_stay_as_they_are() -> None:
    one, other = socket.socketpair()
    with one, other:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGERS)
        give_up_in_time(1234)
        assert lingers(one)
        one.sendall(b"still there")
        assert other.recv(100) == b"still there"


def test_a_socket_whose_number_has_become_a_file_leaves_nothing_open(monkeypatch: pytest.MonkeyPatch) -> None:
    one, other = socket.socketpair()
    with one, other:
        monkeypatch.setattr(os, "dup", lambda _: os.memfd_create("no socket"))
        before = open_descriptors()
        assert list(tcp_sockets()) == []
        assert open_descriptors() == before
