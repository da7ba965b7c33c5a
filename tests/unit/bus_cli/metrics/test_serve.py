"""bus_cli.metrics.serve: accepted requests; a slow client does not hold up others."""

import re
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection

import pytest

pytest.importorskip("prometheus_client")

from prometheus_client.metrics_core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector, CollectorRegistry

from bus_cli.metrics import serve as module
from bus_cli.metrics.serve import open_server
from bus_cli.output import CommandError
from bus_web.place import Place, parse_place
from conftest import WAIT_S
from rows import for_each


class Answer(Collector):
    """A collector with a single metric."""

    def collect(self) -> list[Metric]:
        return [GaugeMetricFamily("answer", "To all.", 42)]


def registry() -> CollectorRegistry:
    found = CollectorRegistry()
    found.register(Answer())
    return found


@contextmanager
def serving(text: str = "127.0.0.1:0") -> Iterator[Place]:
    with open_server(parse_place(text), registry()) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server.place
        finally:
            server.shutdown()
            thread.join()
            for answering in threading.enumerate():
                if "process_request_thread" in answering.name:
                    answering.join(WAIT_S)


def ask(place: Place, host: str | None = None, verb: str = "GET") -> tuple[int, bytes]:
    connection = HTTPConnection(place.address, place.port, timeout=WAIT_S)
    try:
        connection.request(verb, "/metrics", headers={} if host is None else {"Host": host})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


@pytest.mark.parametrize("text", ["127.0.0.1:0", "[::1]:0"])
def test_the_page(text: str) -> None:
    if text.startswith("[") and not has_ipv6():
        pytest.skip("this machine has no ::1")
    with serving(text) as place:
        assert place.port
        status, page = ask(place)
        assert (status, page.splitlines()[-1]) == (200, b"answer 42.0")
        assert ask(place, verb="DELETE")[0] == 405


@for_each(
    ("host", "expected"),
    [
        ("localhost", 200),
        ("LOCALHOST:80", 200),
        ("127.0.0.1:9464", 200),
        ("", 200),
        ("evil.example", 403),
        ("localhost.evil.example:9464", 403),
        ("127.0.0.2", 403),
        (":9464", 403),
    ],
)
def test_only_by_our_own_names(host: str, expected: int) -> None:
    """The owner of a name can point it to loopback, so that a page in a browser reaches this server."""
    with serving() as place:
        status, page = ask(place, host)
        assert status == expected
        assert (b"answer 42.0" in page) is (expected == 200)


def test_a_port_in_use() -> None:
    with serving() as place:
        said = rf"can't listen on 127.0.0.1:{place.port}: .*; choose another port with --listen"
        with pytest.raises(CommandError, match=said):
            open_server(place, registry())


def test_an_address_that_this_machine_does_not_have() -> None:
    with pytest.raises(CommandError, match=re.escape("can't listen on [::2]:9464: ")):
        open_server(Place("::2", 9464), registry())


def test_nobody_waits_for_one_that_says_nothing(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module._Handler, "timeout", 0.05)
    with serving() as place, socket.create_connection(place[:2], WAIT_S) as silent:
        silent.sendall(b"GET /met")
        assert ask(place)[0] == 200
        assert silent.recv(100) == b""
    assert capfd.readouterr() == ("", "")


def test_one_that_hangs_up_is_no_news(capfd: pytest.CaptureFixture[str]) -> None:
    with serving() as place:
        for request in (b"", b"GET", b"GET /metrics HTTP/1.1\r\n\r\n"):
            with socket.create_connection(place[:2], WAIT_S) as client:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # a reset
                client.sendall(request)
        assert ask(place)[0] == 200
    assert capfd.readouterr() == ("", "")
