"""The addresses of a server, and its access check for these addresses."""

from pathlib import Path
from urllib.parse import urlsplit

from bus_web.entrance import open_gate
from bus_web.gate import Ask, Enter, Redirect, Refuse
from bus_web.place import Place


def test_the_addresses_open_the_gate() -> None:
    gate, addresses = open_gate(Place("127.0.0.1", 1234), ["http://localhost:3000"])
    assert addresses.forwarding == ""
    assert addresses.websocket == addresses.page.replace("http:", "ws:")
    decisions = []
    for address in (addresses.page, addresses.page, addresses.once, addresses.once):
        parts = urlsplit(address)
        assert parts.netloc == "127.0.0.1:1234"
        ask = Ask(f"{parts.path}?{parts.query}", host=[parts.netloc], origin=["http://localhost:3000"])
        decisions.append(type(gate.judge(ask, is_socket=False)))
    assert decisions == [Redirect, Redirect, Redirect, Refuse], "the ticket is good once"
    token = urlsplit(addresses.page).query.removeprefix("token=")
    cookie = f"{Place('127.0.0.1', 1234).cookie}={token}"
    assert gate.judge(Ask("/", host=["localhost"], cookie=[cookie]), is_socket=False) == Enter(
        "/", "localhost"
    )


def test_each_start_has_others() -> None:
    _, one = open_gate(Place("127.0.0.1", 1))
    _, other = open_gate(Place("127.0.0.1", 1))
    assert len({one.page, one.once, other.page, other.once}) == 4


def test_of_a_unix_socket() -> None:
    _, addresses = open_gate(Place(path=Path("/run/x.sock")))
    assert addresses.page.startswith("http://127.0.0.1:8765/?token=")
    assert addresses.forwarding == "ssh -NL 8765:/run/x.sock HOST"
