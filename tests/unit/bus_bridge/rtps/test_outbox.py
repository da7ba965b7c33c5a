"""Submessages share datagrams, up to a size."""

from bus_bridge.rtps.messages import read_datagram, write_data
from bus_bridge.rtps.outbox import Outbox
from bus_bridge.rtps.parameters import Address

PREFIX, ONE, TWO = b"p" * 12, b"1" * 12, b"2" * 12
HERE, THERE = ("10.0.0.1", 1), ("10.0.0.1", 2)


def test_packing() -> None:
    sent: list[tuple[Address, list[int]]] = []

    def transmit(address: Address, datagram: bytes) -> None:
        read = read_datagram(datagram)
        assert not read.fault and len({one.destination for one in read.received}) == 1
        sent.append((address, [getattr(one.submessage, "number", 0) for one in read.received]))

    def data(number: int, size: int = 10) -> bytes:
        return write_data(b"rrr4", b"www3", number, bytes(size))

    outbox = Outbox(PREFIX, transmit, 200)
    outbox.put(HERE, ONE, [data(1), data(2)])
    outbox.put(THERE, ONE, [data(3)])
    outbox.put(HERE, TWO, [data(4)])
    outbox.put(HERE, ONE, [data(5)])
    assert sent == []
    outbox.put(HERE, ONE, [data(6), data(7)])
    assert sent == [(HERE, [1, 2, 5])]
    outbox.put(HERE, ONE, [data(8, 500)])
    outbox.flush()
    assert sent[1:] == [(HERE, [6, 7]), (THERE, [3]), (HERE, [4]), (HERE, [8])]
    outbox.flush()
    assert len(sent) == 5
    outbox.put_for_all(THERE, [data(9)])
    assert sent[5:] == [(THERE, [9])]


def test_in_the_name_of_another_participant() -> None:
    sent: list[tuple[Address, bytes]] = []
    outbox = Outbox(PREFIX, lambda *one: sent.append(one), 200)
    outbox.put_for_another(THERE, ONE, [write_data(b"rrr4", b"www3", 1, b"sample")], TWO)
    ((address, datagram),) = sent
    (received,) = read_datagram(datagram).received
    assert (address, received.source, received.destination) == (THERE, TWO, ONE)
