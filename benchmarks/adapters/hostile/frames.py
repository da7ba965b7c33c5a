"""Attacks with valid frames all the time, from permanent connections."""

from collections.abc import Callable
from contextlib import ExitStack
from itertools import count

from benchmarks.adapters.hostile.attack import Attack
from benchmarks.adapters.hostile.pump import Feed, Pump, repeated
from benchmarks.adapters.hostile.raw import Client, control, endpoint, records, run
from benchmarks.adapters.hostile.tally import Tally

_KEEP_ALL = {"history": "keep_all"}
_BLOCK_BYTES = 1 << 16
_BATCH = 100


def runs(attack: Attack, tally: Tally) -> None:
    """Send samples by socket to a peer that never reads; its subscription keeps all."""
    with Client() as talker, Client() as sleeper:
        sleeper.subscription(endpoint(sleeper.node(), "/hostile", _KEEP_ALL))
        number = talker.publisher(endpoint(talker.node(), "/hostile"))
        body = records([b"x" * attack.size] * attack.samples)
        seqs = count(1, attack.samples)
        times = max(1, _BLOCK_BYTES // len(body))

        def block() -> bytes:
            return b"".join(run(number, next(seqs), attack.samples, body) for _ in range(times))

        Pump([Feed(talker, block, times * attack.samples)], sleepers=[sleeper]).run(tally)


def acks(attack: Attack, tally: Tally) -> None:
    """Acknowledge one sample again and again; each connection has its own sample."""
    _flood(attack, tally, _ack)


def reports(attack: Attack, tally: Tally) -> None:
    """Report a subscription's counters."""
    _flood(attack, tally, _report)


def signs_of_life(attack: Attack, tally: Tally) -> None:
    """Send AssertLiveliness for a publisher without a lease."""
    _flood(attack, tally, _sign_of_life)


def attaches(attack: Attack, tally: Tally) -> None:
    """Send Attach for a subscription whose match uses the socket."""
    _flood(attack, tally, _attach)


def pings(attack: Attack, tally: Tally) -> None:
    """Send pings; busd answers each with a Pong."""
    _flood(attack, tally, lambda client, index: control("ping", number=5))


def questions(attack: Attack, tally: Tally) -> None:
    """Request the graph with statistics. It contains `number` endpoints of this program."""
    _flood(attack, tally, lambda client, index: control("graph?", request=1, statistics=True), 50)


def observers(attack: Attack, tally: Tally) -> None:
    """Start and stop watching the graph. It contains `number` endpoints of this program."""
    both = control("observe", request=1, on=True) + control("observe", request=2, on=False)
    _flood(attack, tally, lambda client, index: both, 50)


def _flood(attack: Attack, tally: Tally, prepare: Callable[[Client, int], bytes], times: int = 500) -> None:
    """Send the frame that `prepare` made for each connection, again and again."""
    with ExitStack() as stack:
        clients = [stack.enter_context(Client()) for _ in range(attack.connections)]
        settlers = [stack.enter_context(Client())] if attack.number else []
        for one in settlers:
            settle(one, attack.number)
        feeds = [repeated(one, prepare(one, index), times) for index, one in enumerate(clients)]
        Pump(feeds, listeners=settlers).run(tally)


def settle(client: Client, number: int) -> None:
    """Declare `number` publishers, each on a different topic."""
    node = client.node()
    for begin in range(0, number, _BATCH):
        topics = [f"/settled_{index}" for index in range(begin, min(begin + _BATCH, number))]
        client.ask(*(("pub+", endpoint(node, topic)) for topic in topics))


def _pair(client: Client, index: int) -> tuple[int, int]:
    """A publisher and a subscription that keep all, and one sample between them."""
    node = client.node(f"hostile_{index}")
    heard = client.subscription(endpoint(node, f"/hostile_{index}", _KEEP_ALL))
    said = client.publisher(endpoint(node, f"/hostile_{index}", _KEEP_ALL))
    client.write(run(said, 1, 1, records([b"x"])))
    return said, heard


def _ack(client: Client, index: int) -> bytes:
    said, heard = _pair(client, index)
    return control("ack", subscription=heard, source=said, seq=1)


def _report(client: Client, index: int) -> bytes:
    _, heard = _pair(client, index)
    return control("report", endpoint=heard, samples=1, bytes=1, dropped={"replaced": 1}, expected=2)


def _sign_of_life(client: Client, index: int) -> bytes:
    said, _ = _pair(client, index)
    return control("alive", publisher=said)


def _attach(client: Client, index: int) -> bytes:
    said, heard = _pair(client, index)
    return control("attach", subscription=heard, source=said, slot=0)
