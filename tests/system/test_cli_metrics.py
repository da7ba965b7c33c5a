"""`bus metrics` as users run it, with a real busd that starts and stops; and `bus daemon peers`."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.request import Request, urlopen

import pytest

from cli import LISTENER, TALKER, Running, bus, script, start
from conftest import WAIT_S, Daemon

pytest.importorskip("prometheus_client")
from bus_cli.metrics.serve import _MOST_CONNECTIONS

_LOOK_S = 0.02
TOPIC = 'busd_topic_messages_total{topic="/topic"}'


def values(text: str) -> dict[str, float]:
    """The value of each sample; the key is the rest of its line."""
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return {name: float(value) for name, value in (line.rsplit(" ", 1) for line in lines)}


def fetch(url: str) -> str:
    with urlopen(url, timeout=WAIT_S) as answer:
        text: str = answer.read().decode()
    return text


def wait_for(url: str, name: str, least: float) -> dict[str, float]:
    """Poll until a value is at least `least`; the values then."""
    while (found := values(fetch(url))).get(name, -1.0) < least:
        time.sleep(_LOOK_S)
    return found


@contextmanager
def exporter() -> Iterator[tuple[Running, str]]:
    """An exporter, and the URL at which it listens."""
    with start("metrics", "--listen", "127.0.0.1:0") as running:
        said, _, url = running.line().rpartition(" ")
        assert said == "metrics at"
        yield running, url


def test_what_two_nodes_do(daemon: Daemon, route: str) -> None:
    with exporter() as (_, url), script(LISTENER), script(TALKER, "0.01"):
        wait_for(url, 'busd_delivered_total{node="/minimal_subscriber",topic="/topic"}', 1)
        found = wait_for(url, TOPIC, 1)  # the publisher's process reports at another time
        assert found["busd_up"] == 1
        assert found[f'busd_matches{{route="{route}",topic="/topic"}}'] == 1
        assert found["busd_nodes"] == 2
        assert 'busd_lost_total{node="/minimal_subscriber",topic="/topic"}' in found
        assert found[f'busd_user_connections{{uid="{os.getuid()}"}}'] == 3  # one is the exporter's own
        if route == "socket":
            assert found["busd_routing_seconds_count"] >= 1
            assert found["busd_routed_messages_total"] >= found["busd_routed_runs_total"] >= 1
            assert found["busd_routing_seconds_sum"] > 0
        else:
            assert found["busd_routed_messages_total"] == 0


def test_busd_dies_and_comes_back(daemon: Daemon) -> None:
    with script(LISTENER), script(TALKER, "0.01"), exporter() as (running, url):
        before = wait_for(url, TOPIC, 5)
        daemon.kill()
        assert values(fetch(url)) == {"busd_up": 0}
        assert "no busd listens on" in running.error_line()
        daemon.restart()
        after = wait_for(url, TOPIC, before[TOPIC] + 1)
        assert after["busd_up"] == 1
        assert "busd answers at" in running.error_line()


def test_a_publisher_that_is_gone_still_counts(daemon: Daemon) -> None:
    with exporter() as (_, url), script(LISTENER):
        with script(TALKER, "0.01"):
            before = wait_for(url, TOPIC, 5)[TOPIC]
        found = wait_for(url, "busd_up", 1)
        while found.get('busd_publishers{topic="/topic"}'):
            time.sleep(_LOOK_S)
            found = values(fetch(url))
        assert found[TOPIC] >= before
        with script(TALKER, "0.01"):
            wait_for(url, TOPIC, found[TOPIC] + 1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it(socket_path: Path, number: signal.Signals) -> None:
    with start("metrics", "--listen", "127.0.0.1:0", is_fresh=True) as running:
        running.line()
        assert running.end(number) == ("", "", -number)


def test_signals_end_it_with_somebody_connected(socket_path: Path) -> None:
    with exporter() as (running, url):
        host, _, port = url.split("/")[2].partition(":")
        with socket.create_connection((host, int(port)), WAIT_S) as client:
            client.sendall(b"GET")
            fetch(url)
            assert running.end(signal.SIGINT).code == -signal.SIGINT


def test_many_slow_connections_keep_nobody_else_out(socket_path: Path) -> None:
    """Any user of the machine may connect. Above the limit the oldest connection ends."""
    with exporter() as (running, url), ExitStack() as stack:
        host, _, port = url.split("/")[2].partition(":")
        slow = [
            stack.enter_context(socket.create_connection((host, int(port)), WAIT_S))
            for _ in range(_MOST_CONNECTIONS + 3)
        ]
        for one in slow[3:]:
            one.sendall(b"GET")
        assert [one.recv(1) for one in slow[:3]] == [b""] * 3
        assert "busd_up 0.0" in fetch(url)
        assert running.end(signal.SIGINT).code == -signal.SIGINT


def test_on_loopback(daemon: Daemon) -> None:
    with start("metrics", "--listen", "127.0.0.1:0", "--json") as running:
        url = json.loads(running.line())["listening"]
        with urlopen(url, timeout=WAIT_S) as answer:
            assert answer.headers["Content-Type"].startswith("text/plain")
            assert b"busd_up 1.0" in answer.read()
        accept = {"Accept": "application/openmetrics-text; version=1.0.0"}
        with urlopen(Request(url, headers=accept), timeout=WAIT_S) as answer:
            assert answer.headers["Content-Type"].startswith("application/openmetrics-text")
            assert answer.read().endswith(b"# EOF\n")


def test_once(daemon: Daemon) -> None:
    result = bus("metrics", "--once")
    assert (result.code, result.err) == (0, "")
    found = values(result.out)
    assert found["busd_nodes"] == 0
    assert found["busd_process_open_fds"] > 3
    lines = [json.loads(line) for line in bus("metrics", "--once", "--json").out.splitlines()]
    assert {"name": "busd_nodes", "labels": {}, "value": 0} in lines


def test_once_without_a_busd(socket_path: Path) -> None:
    result = bus("metrics", "--once")
    assert (result.code, result.err) == (0, f"no busd listens on {socket_path}\n")
    assert values(result.out) == {"busd_up": 0}
    assert not socket_path.exists()


def test_a_busd_that_stands_still(daemon: Daemon) -> None:
    os.kill(daemon.pid, signal.SIGSTOP)
    result = bus("metrics", "--once")
    assert values(result.out) == {"busd_up": 0}
    assert "does not answer" in result.err


def test_nothing_that_others_can_reach(socket_path: Path) -> None:
    result = bus("metrics", "--listen", "0.0.0.0:9464")
    assert result.code == 2
    assert "argument --listen: 0.0.0.0 is not loopback" in result.err


def test_a_place_that_cannot_be_had(socket_path: Path) -> None:
    with exporter() as (_, url):
        place = url.split("/")[2]
        result = bus("metrics", "--listen", place)
    assert (result.out, result.code) == ("", 1)
    assert re.fullmatch(rf"can't listen on {place}: [^\n]*; choose another port with --listen\n", result.err)
    result = bus("metrics", "--listen", "127.0.0.1:http")
    assert result.code == 2
    assert "argument --listen: '127.0.0.1:http' is not address:port, such as 127.0.0.1:9464\n" in result.err


def test_without_prometheus_client(socket_path: Path) -> None:
    code = "import sys; sys.modules['prometheus_client'] = None; import bus_cli.main as it; it.main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "metrics", "--once"], capture_output=True, text=True, timeout=WAIT_S
    )
    assert done.returncode == 1
    assert re.fullmatch(
        r"metrics need prometheus-client \(.*\): pip install 'prometheus-client>=0.20'\n", done.stderr
    )


@pytest.mark.parametrize("settings", ["[limits]\nendpoints_per_peer = 10\n"])
def test_daemon_peers(daemon: Daemon, settings: str) -> None:
    with script(LISTENER) as listener:
        title, rule, row = bus("daemon", "peers").out.splitlines()
        (peer,) = [json.loads(line) for line in bus("daemon", "peers", "--json").out.splitlines()]
        (user,) = [json.loads(line) for line in bus("daemon", "peers", "--users", "--json").out.splitlines()]
    columns = "pid uid program nodes endpoints topics descriptors queued history refused silent"
    assert (title.split(), set(rule)) == (columns.split(), {"="})
    assert row.split()[:2] == [str(listener.process.pid), str(os.getuid())]
    assert " 2 (20%) " in row
    assert (peer["pid"], peer["nodes"], peer["endpoints"]) == (listener.process.pid, 1, 2)
    assert (user["uid"], user["connections"], user["endpoints"]) == (os.getuid(), 2, 2)


def test_daemon_peers_without_a_daemon(socket_path: Path) -> None:
    result = bus("daemon", "peers")
    assert (result.out, result.err, result.code) == ("", f"no busd listens on {socket_path}\n", 1)
