"""bus.cli.query: what is made of a broker that goes, refuses or says nothing."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus.cli import query as module
from bus.cli.query import Query
from bus.errors import BrokerUnavailable, BusError, ConnectionClosed, RemoteProtocolError
from bus.wire import messages as m
from bus.wire.layout import VERSION

HELLO = m.Hello(version=VERSION, pid=1, program="busd", release="0.1.0")
OLD_HELLO = m.Hello(version=VERSION, pid=1, program="busd")
GRAPH = m.Graph(request=1, revision=0, nodes=(), endpoints=(), matches=())


@pytest.fixture
def broker(monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """The other end of the next query."""
    ours, theirs = socket.socketpair()
    theirs.settimeout(20)
    monkeypatch.setattr(module, "_connect", lambda path, answer_s: theirs)
    with ours, theirs:
        yield ours


def say(broker: socket.socket, *messages: m.Message) -> None:
    broker.sendall(b"".join(map(m.encode_frame, messages)))


def test_who_is_turned_away_is_told_why(broker: socket.socket) -> None:
    """It has said so and gone before we said anything."""
    say(broker, HELLO, m.Fault(text="connections: 1 of 1 in use"))
    broker.close()
    with pytest.raises(RemoteProtocolError, match="connections: 1 of 1 in use"), Query(Path("x")) as query:
        query.graph()


def test_one_that_went_without_a_word(broker: socket.socket) -> None:
    broker.close()
    with pytest.raises(ConnectionClosed, match="busd at x closed the connection"):
        Query(Path("x"))


def test_one_that_says_nothing(broker: socket.socket) -> None:
    with pytest.raises(BrokerUnavailable, match="busd at x took the connection but does not answer"):
        Query(Path("x"), answer_s=0.01)


def test_charges(broker: socket.socket) -> None:
    say(broker, HELLO, GRAPH, m.Peers(request=2, peers=(), users=(), limits={"topics": 7}))
    with Query(Path("x")) as query:
        assert query.graph().nodes == ()
        charges = query.charges()
    assert charges is not None
    assert charges.limits == {"topics": 7}


def test_charges_of_an_old_busd(broker: socket.socket) -> None:
    """It does not know the question, and is not asked."""
    say(broker, OLD_HELLO, GRAPH)
    with Query(Path("x")) as query:
        assert query.charges() is None
        assert query.graph().nodes == ()


@pytest.mark.parametrize(
    "answer", [m.Fault(text="8 of 8 in use"), m.Refused(request=1, text="8 of 8 in use")]
)
def test_charges_that_are_refused(broker: socket.socket, answer: m.Message) -> None:
    say(broker, HELLO, answer)
    with Query(Path("x")) as query, pytest.raises(BusError, match="8 of 8 in use"):
        query.charges()
