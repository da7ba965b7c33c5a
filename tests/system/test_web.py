"""`bus web` as users run it: access, messages, costs, and its end."""

import json
import re
import signal
import socket
import stat
import struct
import time
from contextlib import ExitStack, closing, suppress
from http.client import HTTPResponse
from pathlib import Path
from typing import Any

import msgspec
import pytest

from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT
from cli import LISTENER, TALKER, bus, script, start, wait_for_graph
from conftest import WAIT_S, Daemon
from neighbours import wait_until
from raw_peer import RawPeer, control
from rows import for_each

pytest.importorskip("websockets", reason="the page's server is made of websockets")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from web_clients import CAMERA, LOSER, PAGE, Silent, own_bytes, serving

MIB = 1 << 20
LATCHED = """
import asyncio, bus
from bus.msg.std_msgs import ByteMultiArray, MultiArrayDimension, MultiArrayLayout
async def main():
    async with bus.Node("once") as node:
        publisher = await node.create_publisher(
            ByteMultiArray, "topic", bus.QoSProfile(1, durability=bus.Durability.TRANSIENT_LOCAL)
        )
        dim = [MultiArrayDimension(size=size) for size in range(20)]
        publisher.publish(ByteMultiArray(layout=MultiArrayLayout(dim=dim)))
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""


def text_of(answer: HTTPResponse) -> str:
    return str(answer.text)  # type: ignore[attr-defined]


class TestGettingIn:
    def test_the_token_gets_a_cookie_and_leaves_the_address(self, daemon: Daemon) -> None:
        with serving() as server:
            assert server.foxglove == server.page.replace("http:", "ws:")
            first = server.get(f"/?token={server.token}")
            assert (first.status, first.headers["Location"]) == (303, "/")
            cookie = first.headers["Set-Cookie"]
            assert cookie.endswith("; Path=/; HttpOnly; SameSite=Strict")
            page = server.get("/", {"Cookie": cookie.partition(";")[0]})
            assert page.status == 200
            assert page.headers["Content-Type"] == "text/html; charset=utf-8"
            assert "default-src 'none'" in page.headers["Content-Security-Policy"]
            assert page.headers["X-Content-Type-Options"] == "nosniff"
            assert [name for name in page.headers if name.startswith("Access-Control")] == []
            assert server.token not in text_of(page)

    def test_who_is_refused(self, daemon: Daemon) -> None:
        with serving() as server:
            cookie = {"Cookie": server.cookie()}
            here = f"{server.host}:{server.port}"

            def status(target: str = "/", **headers: str) -> int:
                return server.get(target, headers).status

            assert status(**cookie, Origin=f"http://{here}") == 200
            assert status() == 403
            assert status("/?token=wrong") == 403
            assert status("/page.js") == 403, "not even the page's files"
            assert status(**cookie, Host="evil.example") == 403
            assert status(f"/?token={server.token}", Host=f"evil.example:{server.port}") == 403
            assert status(**cookie, Origin="http://evil.example") == 403
            assert status(**cookie, Origin="null") == 403
            assert status("/../server.py", **cookie) == 404
            assert status("/vendor/..%2f..%2fserver.py", **cookie) == 404

    def test_websockets_are_refused_in_the_same_way(self, daemon: Daemon) -> None:
        with serving("--allow-origin", "http://localhost:3000") as server:
            here = f"ws://{server.host}:{server.port}/"

            def status(address: str, origin: str | None = None, *protocols: str) -> int:
                offered = [Subprotocol(one) for one in protocols or (PAGE,)]
                given = Origin(origin) if origin else None
                try:
                    with connect(address, origin=given, subprotocols=offered, proxy=None):
                        return 101
                except InvalidStatus as refused:
                    return refused.response.status_code

            with_token = f"{here}?token={server.token}"
            assert status(with_token) == 101
            assert status(with_token, "https://app.foxglove.dev") == 101
            assert status(with_token, "http://localhost:3000") == 101
            assert status(here) == 403
            assert status(f"{here}?token=wrong") == 403
            assert status(with_token, "http://evil.example") == 403
            assert status(with_token, None, "nonsense.v1") == 400

    def test_what_is_no_http_is_no_news(self, daemon: Daemon) -> None:
        with serving() as server:
            for garbage in (b"\x00\xff\r\n\r\n", b"GET / HTTP/9\r\n\r\n", b"POST / HTTP/1.1\r\n\r\n", b"G"):
                with socket.create_connection((server.host, server.port)) as rude:
                    rude.sendall(garbage)
                    rude.shutdown(socket.SHUT_WR)
                    while rude.recv(4096):
                        pass
            assert server.get("/", {"Cookie": server.cookie()}).status == 200
            assert server.running.end(signal.SIGINT) == ("", "", -signal.SIGINT)

    def test_strangers_who_say_nothing_keep_nobody_out(self, daemon: Daemon) -> None:
        """The server closes the oldest of many idle connections, so that descriptors are left for others."""
        with serving(is_fresh=True) as server, ExitStack() as strangers:
            folder = Path(f"/proc/{server.running.process.pid}/fd")
            before = len([*folder.iterdir()])
            oldest, *_ = [
                strangers.enter_context(socket.create_connection((server.host, server.port), WAIT_S))
                for _ in range(300)
            ]
            with suppress(ConnectionResetError):
                assert oldest.recv(1) == b""
            assert server.get("/", {"Cookie": server.cookie()}).status == 200
            wait_until(lambda: len([*folder.iterdir()]) - before < 150)
            assert server.running.end(signal.SIGINT) == ("", "", -signal.SIGINT)

    def test_two_headers_that_ask_for_a_websocket(self, daemon: Daemon) -> None:
        with serving() as server, socket.create_connection((server.host, server.port), WAIT_S) as asking:
            lines = ("GET / HTTP/1.1", f"Host: localhost:{server.port}", "Upgrade: a", "Upgrade: b")
            asking.sendall("\r\n".join((*lines, "", "")).encode())
            assert asking.recv(12) == b"HTTP/1.1 403"


class TestWhatIsTold:
    def test_the_graph_rates_and_values(self, daemon: Daemon, route: str) -> None:
        with script(LISTENER), script(TALKER, "0.01"), serving() as server, server.viewer() as viewer:
            assert viewer.hear("hello")["bus"] == str(daemon.path)
            graph = viewer.hear("graph", lambda told: len(told["ends"]) >= 2 and told["pairs"])
            names = {one[1] for one in graph["nodes"] if not one[3]}
            assert names == {"/minimal_publisher", "/minimal_subscriber"}
            (pair,) = [pair for pair in graph["pairs"] if pair[2] == route]
            viewer.hear("rates", lambda told: 10 < (told["topics"].get("/topic", [0])[0] or 0) < 150)
            viewer.say("look", topics={"/topic": []})
            first = viewer.hear("value")
            assert (first["topic"], first["type"]) == ("/topic", "std_msgs/msg/String")
            assert re.fullmatch(r"Hello World: \d+", first["tree"]["data"])
            assert viewer.hear("value")["tree"] != first["tree"]
            assert 0 <= first["age_ms"] < 10_000
            detail = viewer.hear("detail")["ends"]
            assert {str(pair[0]), str(pair[1])} == detail.keys()

    def test_at_most_twenty_values_a_second(self, daemon: Daemon) -> None:
        with script(TALKER, "0.001"), serving() as server, server.viewer() as viewer:
            viewer.hear("graph", lambda told: told["ends"])
            began_s = time.monotonic()  # values in transit were already limited before
            viewer.say("look", topics={"/topic": []})
            first = viewer.hear("value")
            for _ in range(20):
                last = viewer.hear("value")
            assert time.monotonic() - began_s > 0.9
            assert last["number"] - first["number"] > 40, "all have come, most are not shown"

    def test_losses_are_those_of_topic_info(self, daemon: Daemon) -> None:
        with script(LOSER), serving() as server, server.viewer() as viewer:
            with script(TALKER, "0.001"):
                viewer.hear("rates", lambda told: (told["topics"].get("/topic") or [0] * 7)[4] > 50)
            viewer.say("look", topics={"/topic": []})

            def are_the_same(told: Any) -> bool:
                info = json.loads(bus("topic", "info", "-v", "/topic", "--json").out)
                (loser,) = [one for one in info["subscriptions"] if one["node"] == "/loser"]
                return any(end[3] == loser["dropped"] for end in told["ends"].values())

            viewer.hear("detail", are_the_same)  # the last losses arrive half a second later

    def test_the_log(self, daemon: Daemon) -> None:
        logger = (
            "import asyncio, bus\n"
            "async def main():\n"
            "    async with bus.Node('speaker') as node:\n"
            "        node.get_logger().warning('<b>hot</b>')\n"
            "        print('ready', flush=True)\n"
            "        await asyncio.Event().wait()\n"
            "bus.run(main())\n"
        )
        with script(logger), serving() as server, server.viewer() as viewer:
            viewer.say("log", on=True)
            lines = viewer.hear("log")["lines"]
            assert [line[1:] for line in lines] == [[30, "speaker", "<b>hot</b>"]]
            viewer.say("log", on=False)

    def test_busd_goes_and_comes_back(self, daemon: Daemon) -> None:
        with script(TALKER, "0.01"), serving() as server, server.viewer() as viewer:
            viewer.say("look", topics={"/topic": []})
            before = viewer.hear("value")["tree"]["data"]
            daemon.kill()
            assert viewer.hear("bus")["is_up"] is False
            daemon.restart()
            viewer.hear("graph", lambda told: any(end[3] == "/topic" for end in told["ends"]))
            number = int(before.rpartition(" ")[2])
            viewer.hear("value", lambda told: int(told["tree"]["data"].rpartition(" ")[2]) > number)
            viewer.hear("rates")

    def test_a_topic_that_comes_back_with_another_type(self, daemon: Daemon) -> None:
        other = TALKER.replace("import String", "import Int64").replace("(String,", "(Int64,")
        other = other.replace('String(data=f"Hello World: {number}")', "Int64(data=number)")
        with serving() as server, server.viewer() as viewer:
            viewer.say("look", topics={"/topic": []})
            for program, name in ((TALKER, "String"), (other, "Int64"), (other, "Int64"), (TALKER, "String")):
                with script(program, "0.01"):
                    viewer.hear("value", lambda told, name=name: told["type"] == f"std_msgs/msg/{name}")

    def test_a_type_that_does_not_match(self, daemon: Daemon) -> None:
        other = LISTENER.replace("String", "Int32")
        with script(TALKER, "0.01"), script(other), serving() as server, server.viewer() as viewer:
            told = viewer.hear("graph", lambda told: any(pair[3] for pair in told["pairs"]))
            assert [pair[3] for pair in told["pairs"]] == [
                "the publisher has std_msgs/msg/String, the subscription std_msgs/msg/Int32"
            ]


class TestMistakes:
    def test_frames_that_are_too_long(self, daemon: Daemon) -> None:
        with serving() as server, server.viewer() as viewer:
            with pytest.raises(ConnectionClosed) as ended:
                viewer.say("look", topics={"/" + "x" * 1_100_000: []})
                viewer.hear("never")
            assert ended.value.rcvd is not None
            assert ended.value.rcvd.code == 1009

    def test_pings_without_end(self, daemon: Daemon) -> None:
        """A client that does not read the answers is cut off before many of them are queued."""
        ping = struct.pack("!BBI", 0x89, 0x80 | 125, 0) + bytes(125)
        with serving(is_fresh=True) as server, server.viewer() as viewer, closing(Silent(server)) as pinging:
            viewer.hear("hello")
            before = own_bytes(server.running.process.pid)
            with pytest.raises(OSError, match=r"reset|Broken pipe"):
                for _ in range(500):
                    pinging.send(1000 * ping)
            assert own_bytes(server.running.process.pid) - before < 8 * MIB
            with server.viewer() as other:
                other.hear("hello")

    @pytest.mark.parametrize("said", ["{", '{"op":"publish"}', b"\x01"])
    def test_what_makes_no_sense(self, daemon: Daemon, said: str | bytes) -> None:
        with serving() as server, server.viewer() as viewer:
            with pytest.raises(ConnectionClosed) as ended:
                viewer.connection.send(said)
                viewer.hear("never")
            assert ended.value.rcvd is not None
            assert (ended.value.rcvd.code, ended.value.rcvd.reason != "") == (1008, True)
            with server.viewer() as other:
                other.hear("hello")

    def test_more_clients_than_there_can_be(self, daemon: Daemon) -> None:
        with serving() as server, ExitStack() as clients:
            for _ in range(16):
                clients.enter_context(server.viewer()).hear("hello")
            with server.viewer() as refused, pytest.raises(ConnectionClosed) as ended:
                refused.hear("never")
            assert ended.value.rcvd is not None
            assert (ended.value.rcvd.code, ended.value.rcvd.reason) == (1008, "16 clients are connected")

    def test_topics_that_are_not_there_or_no_topics(self, daemon: Daemon) -> None:
        with serving() as server, server.viewer() as viewer:
            viewer.say("look", topics={"/nothing": [], "no topic": ["a.b"], "": []})
            viewer.hear("rates")
            with script(TALKER.replace('"topic"', '"nothing"'), "0.01"):
                assert viewer.hear("value")["topic"] == "/nothing"

    @for_each(
        ("words", "code", "says"),
        [
            (["--listen", "0.0.0.0:8765"], 2, "ssh -NL 8765:127.0.0.1:8765 HOST"),
            (["--listen", "8765"], 2, "neither address:port"),
            (["--allow-origin", "evil"], 2, "'evil' is not an origin"),
            (["--allow-origin", "http://["], 2, "'http://[' is not an origin"),
            (["--allow-origin", "http://a:999999"], 2, "'http://a:999999' is not an origin"),
            (["--allow-origin", "http://user@a"], 2, "'http://user@a' is not an origin"),
            (["--allow-origin", "http://a/#b"], 2, "'http://a/#b' is not an origin"),
            (["--allow-origin", "http://a b"], 2, "'http://a b' is not an origin"),
            (["--listen", "unix:/tmp/x", "--open"], 1, "a browser opens no unix socket"),
        ],
    )
    def test_of_the_command_line(self, daemon: Daemon, words: list[str], code: int, says: str) -> None:
        result = bus("web", *words)
        assert result.code == code
        assert says in result.err.replace("\n", " ")

    def test_a_port_that_is_taken(self, daemon: Daemon) -> None:
        with serving() as server:
            result = bus("web", "--listen", f"127.0.0.1:{server.port}")
            assert result.err == (
                f"can't listen on 127.0.0.1:{server.port}: Address already in use; "
                "choose another port with --listen\n"
            )
            assert result.code == 1


class TestWhatItCosts:
    def test_nothing_is_subscribed_unless_somebody_looks(self, daemon: Daemon) -> None:
        def subscribers(graph: Any) -> list[str]:
            return [one.node.name for one in graph.subscriptions_of("/topic")]

        with script(TALKER, "0.01"), serving() as server:
            wait_for_graph(lambda graph: any(one.name.startswith("_bus_web") for one in graph.nodes))
            with server.viewer() as viewer, server.viewer() as other:
                viewer.hear("rates")
                assert wait_for_graph(lambda graph: True).subscriptions_of("/topic") == []
                for one in (viewer, other):
                    one.say("look", topics={"/topic": []})
                    one.hear("value")
                (name,) = subscribers(wait_for_graph(subscribers))
                assert name.startswith("_bus_web")
                viewer.say("look", topics={})
                other.hear("value")
                assert subscribers(wait_for_graph(lambda graph: True)) == [name]
            wait_for_graph(lambda graph: not subscribers(graph))

    def test_without_a_page_it_asks_busd_nothing(self, daemon: Daemon) -> None:
        def busy_s(pid: int) -> float:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            return (int(fields[11]) + int(fields[12])) / 100

        with script(TALKER, "0.001"), serving() as server:
            with server.viewer() as viewer:
                viewer.hear("rates")
            wait_for_graph(lambda graph: len(graph.nodes) == 2)

            def is_quiet() -> bool:
                before_s = busy_s(server.running.process.pid)
                time.sleep(2.0)  # to see that nothing happens
                return busy_s(server.running.process.pid) - before_s <= 0.03

            wait_until(is_quiet)

    def test_a_page_that_stops_reading(self, daemon: Daemon) -> None:
        """It costs at most its queue, others get everything, and later it learns how much it has missed."""
        topics: dict[str, list[str]] = {"/image": [], "/topic": []}
        with script(TALKER, "0.005"), script(CAMERA, "0.01"), serving() as server, server.viewer() as viewer:
            viewer.say("look", topics=topics)
            for _ in range(40):
                viewer.hear("value")
            before = own_bytes(server.running.process.pid)
            with closing(Silent(server)) as silent, closing(Silent(server)) as other:
                silent.say("look", topics=topics)
                other.say("look", topics=topics)
                for _ in range(100):  # meanwhile 50 images of 670 kB arrive for the silent ones
                    viewer.hear("value")
                assert own_bytes(server.running.process.pid) - before < 2 * 16 * MIB
                silent.hear_of_missed(1)
            viewer.hear("value")


def test_what_a_browser_s_command_line_says_is_good_once(
    daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = tmp_path / "told"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" >{told}.part && mv {told}.part {told}\n')
    browser.chmod(0o700)
    monkeypatch.setenv("BROWSER", str(browser))
    with serving("--open", is_fresh=True) as server:
        wait_until(told.exists)
        address = told.read_text().strip()
        assert address.startswith(f"http://127.0.0.1:{server.port}/?token=")
        assert server.token not in address
        target = address.partition(str(server.port))[2]
        assert [server.get(target).status for _ in range(2)] == [303, 403]


def test_an_array_is_opened_after_its_only_message(daemon: Daemon) -> None:
    with script(LATCHED), serving() as server, server.viewer() as viewer:
        viewer.hear("graph", lambda told: told["ends"])
        viewer.say("look", topics={"/topic": []})
        assert len(viewer.hear("value")["tree"]["layout"]["dim"]["head"]) == 8
        viewer.say("look", topics={"/topic": ["layout.dim"]})
        assert len(viewer.hear("value")["tree"]["layout"]["dim"]["head"]) == 20


class TestUnixSocket:
    def ask(self, path: Path, target: str) -> str:
        with socket.socket(socket.AF_UNIX) as asking:
            asking.connect(str(path))
            asking.sendall(f"GET {target} HTTP/1.1\r\nHost: localhost:8765\r\n\r\n".encode())
            answer = b""
            while part := asking.recv(65536):
                answer += part
        return answer.decode()

    def test_it_is_for_its_user_and_goes_with_it(self, daemon: Daemon, tmp_path: Path) -> None:
        path = tmp_path / "web.sock"
        with start("web", "--listen", f"unix:{path}") as running:
            assert running.line() == f"first: ssh -NL 8765:{path} HOST"
            page = running.line().removeprefix("page: ")
            running.line()
            assert page.startswith("http://127.0.0.1:8765/?token=")
            assert stat.S_IMODE(path.stat().st_mode) == 0o600
            assert self.ask(path, page.removeprefix("http://127.0.0.1:8765")).startswith("HTTP/1.1 303")
            assert self.ask(path, "/").startswith("HTTP/1.1 403")
            again = bus("web", "--listen", f"unix:{path}")
            assert (again.code, again.err) == (1, f"can't listen on unix:{path}: another process uses it\n")
            assert running.end(signal.SIGINT) == ("", "", -signal.SIGINT)
        assert not path.exists()

    def test_what_is_in_the_way(self, daemon: Daemon, tmp_path: Path) -> None:
        path = tmp_path / "web.sock"
        with socket.socket(socket.AF_UNIX) as left_behind:
            left_behind.bind(str(path))
        with start("web", "--listen", f"unix:{path}", "--json") as running:
            assert json.loads(running.line()).keys() == {"page", "foxglove", "forwarding"}
        path.unlink(missing_ok=True)
        with socket.socket(socket.AF_UNIX) as hanging, ExitStack() as waiting:
            hanging.bind(str(path))
            hanging.listen(0)
            for _ in range(2):  # so that even the backlog is full
                one = waiting.enter_context(socket.socket(socket.AF_UNIX))
                one.setblocking(False)
                with suppress(BlockingIOError):
                    one.connect(str(path))
            again = bus("web", "--listen", f"unix:{path}")
            assert (again.code, again.err) == (1, f"can't listen on unix:{path}: another process uses it\n")
        path.unlink()
        path.write_text("precious")
        result = bus("web", "--listen", f"unix:{path}")
        assert (result.code, result.err) == (1, f"can't listen on unix:{path}: it is not a socket\n")
        assert path.read_text() == "precious"

    def test_what_is_there_in_the_end_is_of_another(self, daemon: Daemon, tmp_path: Path) -> None:
        path = tmp_path / "web.sock"
        with start("web", "--listen", f"unix:{path}", "--json") as running:
            running.line()
            path.unlink()
            with socket.socket(socket.AF_UNIX) as other:
                other.bind(str(path))
                assert running.end(signal.SIGINT) == ("", "", -signal.SIGINT)
        assert path.is_socket()


class TestEnd:
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_signals_end_it_with_pages_open(self, daemon: Daemon, number: signal.Signals) -> None:
        with script(CAMERA, "0.01"), serving(is_fresh=True) as server, server.viewer() as viewer:
            viewer.say("look", topics={"/image": []})
            viewer.hear("value")
            with (
                closing(Silent(server)) as silent,
                socket.create_connection((server.host, server.port)) as half,
            ):
                silent.say("look", topics={"/image": []})
                half.sendall(b"GET")
                viewer.hear("value")
                out, err, status = server.running.end(number)
                # Under other load its loop may have been held up, and it logs that.
                lines = [line for line in err.splitlines() if "held up the event loop" not in line]
                assert (out, lines, status) == ("", [], -number)

    def test_another_start_has_another_token(self, daemon: Daemon) -> None:
        with serving() as server:
            cookie, port = server.cookie(), server.port
        with serving("--listen", f"127.0.0.1:{port}") as again:
            assert again.token != server.token
            assert again.get("/", {"Cookie": cookie}).status == 403
            assert "the address that the server has printed" in text_of(again.get("/", {"Cookie": cookie}))


def test_without_websockets(daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "websockets.py").write_text("raise ImportError('No module named websockets')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    result = bus("web", is_fresh=True)
    assert (result.code, result.out) == (1, "")
    assert result.err.endswith("pip install 'websockets>=15'\n")


REASON = "\x1b[2J[red]<b>\u202e"


def lies(endpoint: int, at_ns: int) -> m.Report:
    """The largest values that busd accepts."""
    dropped = {REASON: MAX_COUNT, **{f"reason {number}": MAX_COUNT for number in range(15)}}
    most = dict.fromkeys(("bytes", "queued", "expected", "age_sum_ns", "age_max_ns"), MAX_COUNT)
    samples = at_ns % 2 * MAX_COUNT
    return m.Report(endpoint, samples, dropped=dropped, at_ns=at_ns, age_count=1, **most)  # type: ignore[arg-type]


def test_counters_that_lie(daemon: Daemon) -> None:
    """Many endpoints report them on a shared topic: the others' rates stay right, and every tool works."""
    with (
        script(TALKER, "0.01"),
        serving() as server,
        RawPeer(daemon.path) as peer,
        server.viewer() as viewer,
    ):
        node = peer.hello().node()
        ends = [peer.subscription(node, "/topic").id for _ in range(6)]
        ends += [peer.publisher(node, "/lies").id for _ in range(6)]
        for at_ns in range(MAX_COUNT - 4, MAX_COUNT + 1):
            peer.send(*(lies(endpoint, at_ns) for endpoint in ends))
            peer.barrier()
            told = viewer.hear("rates", lambda told: told["topics"].get("/topic", [None])[0])
        rate, _, queued, _, lost, *_ = told["topics"]["/topic"]
        assert 20 < rate < 200
        # The peer does not read while the viewer waits, so busd's own queue for it may be full: depth 10.
        assert (queued - MAX_COUNT in range(11), lost >= 6 * 16 * MAX_COUNT) == (True, True), told
        for words in (
            ("top", "--once", "-d", "0.2"),
            ("top", "--once", "--json", "-d", "0.2"),
            ("topic", "info", "-v", "/topic"),
            ("metrics", "--once"),
        ):
            result = bus(*words)
            assert (result.code, result.err) == (0, "")
            assert not {"\x1b", "\u202e"} & {*result.out}


def test_counters_that_are_none(daemon: Daemon) -> None:
    """busd closes the connection of a peer that reports them, and nothing else changes."""
    wrong: list[dict[str, Any]]
    wrong = [{"samples": -1}, {"queued": 1 << 62}, {"at_ns": "soon"}, {"dropped": {"a": -1}}, {}]
    with script(TALKER, "0.01"), serving() as server, server.viewer() as viewer:
        viewer.hear("rates", lambda told: "/topic" in told["topics"])
        for fields in wrong:
            with RawPeer(daemon.path) as peer:
                end = peer.hello().subscription(peer.node(), "/topic").id
                body = {
                    "type": "report",
                    "endpoint": end,
                    **({"samples": 1, "bytes": 1, **fields} if fields else {}),
                }
                peer.write(control(msgspec.msgpack.encode(body)))
                assert peer.fault().startswith("control message not understood: "), fields
            viewer.hear("graph", lambda told, end=end: not any(one[0] == end for one in told["ends"]))
        viewer.hear("rates", lambda told: "/topic" in told["topics"])
