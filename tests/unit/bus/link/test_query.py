"""bus.link.query: the result if a broker goes away, refuses or says nothing."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from bus.errors import BrokerUnavailable, BusError, RemoteProtocolError
from bus.link import query as module
from bus.link.query import Query
from bus.wire import messages as m
from bus.wire.layout import PROTOCOL_VERSION

HELLO = m.Hello(version=PROTOCOL_VERSION, pid=1, program="busd", release="0.1.0")
OLD_HELLO = m.Hello(version=PROTOCOL_VERSION, pid=1, program="busd")
GRAPH = m.GraphSnapshot(request=1, revision=0, nodes=(), endpoints=(), matches=())


@pytest.fixture
def brokers(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[socket.socket]]:
    """The other ends of the next two queries. All later queries find a broker that has gone."""
    with ExitStack() as stack:
        pairs = [socket.socketpair() for _ in range(2)]
        for ours, theirs in pairs:
            stack.enter_context(ours)
            stack.enter_context(theirs)
        left = [theirs for _, theirs in pairs]
        monkeypatch.setattr(module, "try_to_connect", lambda path: left.pop(0) if left else one_that_went())
        yield [ours for ours, _ in pairs]


def one_that_went() -> socket.socket:
    ours, theirs = socket.socketpair()
    ours.close()
    return theirs


@pytest.fixture
def broker(brokers: list[socket.socket]) -> socket.socket:
    return brokers[0]


def say(broker: socket.socket, *messages: m.Message) -> None:
    broker.sendall(b"".join(map(m.encode_frame, messages)))


def test_who_is_turned_away_is_told_why(broker: socket.socket) -> None:
    """The broker has sent the reason and gone before the query sends anything."""
    say(broker, HELLO, m.Fault(text="connections: 1 of 1 in use"))
    broker.close()
    with pytest.raises(RemoteProtocolError, match="connections: 1 of 1 in use"), Query(Path("x")) as query:
        query.graph()


def test_one_that_goes_without_a_word_may_be_followed_by_another(brokers: list[socket.socket]) -> None:
    """A broker that ends with connections in its backlog goes without a word."""
    brokers[0].close()
    say(brokers[1], HELLO, GRAPH)
    with Query(Path("x")) as query:
        assert query.graph().nodes == ()


@pytest.mark.parametrize("words", [(), (HELLO, m.Fault(text="not now", again=True))], ids=["silent", "busy"])
def test_one_that_goes_again_and_again(brokers: list[socket.socket], words: tuple[m.Message, ...]) -> None:
    say(brokers[0], *words)
    brokers[0].close()
    brokers[1].close()
    why = "busd at x (closed the connection|refused this process: not now); tried for 0.05 s"
    with pytest.raises(BrokerUnavailable, match=why):
        Query(Path("x"), answer_s=0.05)


def test_who_is_turned_away_for_now_tries_again(brokers: list[socket.socket]) -> None:
    say(brokers[0], HELLO, m.Fault(text="not now", again=True))
    say(brokers[1], HELLO, GRAPH)
    with Query(Path("x")) as query:
        assert query.graph().nodes == ()


def test_one_that_says_nothing(broker: socket.socket) -> None:
    with pytest.raises(
        BrokerUnavailable, match=r"^busd at x does not answer: it has said nothing for 0\.01 s$"
    ):
        Query(Path("x"), answer_s=0.01)


def test_after_a_while_it_says_that_it_waits(broker: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    for place in ("bus.link.reach", "bus.link.query"):
        monkeypatch.setattr(f"{place}.TELL_S", 0.01)
    say(broker, HELLO)
    with (
        Query(Path("x"), answer_s=0.03, on_slow=said.append) as query,
        pytest.raises(BrokerUnavailable),
    ):
        query.graph()
    assert said == ["busd at x has said nothing for 0.01 s; still waiting for its answer"]


def test_one_that_greets_and_says_nothing_more(broker: socket.socket) -> None:
    say(broker, HELLO)
    with (
        Query(Path("x"), answer_s=0.01) as query,
        pytest.raises(
            BrokerUnavailable, match=r"^busd at x does not answer: it has said nothing for 0\.01 s$"
        ),
    ):
        query.graph()


def test_charges(broker: socket.socket) -> None:
    say(broker, HELLO, GRAPH, m.Peers(request=2, peers=(), users=(), limits={"topics": 7}))
    with Query(Path("x")) as query:
        assert query.graph().nodes == ()
        charges = query.charges()
    assert charges is not None
    assert charges.limits == {"topics": 7}


def test_charges_of_an_old_busd(broker: socket.socket) -> None:
    """An old busd does not know this question, so the query does not ask."""
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
