"""`bus bridge`, as users run it: two buses joined by zenoh, mistakes, the end, its status."""

import json
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import pytest

from bus.graph import Graph
from cli import LISTENER, TALKER, Running, bus, start
from conftest import Daemon
from forks import Forks
from pages import ROOT, console, shape
from ports import free_port, own_domain
from two_buses import bridge, script_on, wait_for_graph_of

DOMAIN = str(own_domain())

needs_zenoh = pytest.mark.skipif(find_spec("zenoh") is None, reason="needs eclipse-zenoh")


@pytest.fixture
def far(tmp_path: Path, forks: Forks) -> Iterator[Daemon]:
    """The busd of another bus."""
    daemon = Daemon(tmp_path / "far.sock", forks=forks)
    yield daemon
    log = daemon.stop()
    assert "Traceback" not in log, log


@pytest.fixture
def joined(daemon: Daemon, far: Daemon) -> Iterator[tuple[Running, Running]]:
    """The bridges of the two buses, linked; this bus is `here`, the other is `there`."""
    place = f"tcp/127.0.0.1:{free_port()}"
    with (
        bridge(daemon.path, "zenoh", "--id", "here", "--listen", place) as here,
        bridge(far.path, "zenoh", "--id", "there", "--connect", place) as there,
    ):
        here.error_line_with("bus 'there'.* is there")
        there.error_line_with("bus 'here'.* is there")
        yield here, there


def shows(*nodes: str) -> Callable[[Graph], bool]:
    return lambda graph: {*nodes} <= {node.full_name for node in graph.nodes}


def lacks(*nodes: str) -> Callable[[Graph], bool]:
    return lambda graph: not {*nodes} & {node.full_name for node in graph.nodes}


class TestTwoBuses:
    pytestmark = needs_zenoh

    def test_the_page_shows_what_is_logged(self, daemon: Daemon, far: Daemon) -> None:
        (shown,) = console((ROOT / "docs" / "bridge.md").read_text())
        port = str(free_port())
        _, *words = shlex.split(shown.command.replace("7447", port))
        ours, theirs = (re.search(rf"'({name}-\w+)'", "".join(shown.lines)) for name in ("robot", "laptop"))
        assert ours and theirs
        with start(*words, "--id", ours[1]) as here:
            lines = [here.error_line(), here.error_line()]
            connect = ("--connect", f"tcp/127.0.0.1:{port}", "--id", theirs[1])
            with bridge(far.path, "zenoh", *connect):
                lines.append(here.error_line())
        for line, pattern in zip(lines, map(shape, shown.lines), strict=True):
            assert re.fullmatch(pattern, line), line

    def test_a_talker_there_is_heard_here(self, daemon: Daemon, far: Daemon, joined: object) -> None:
        with script_on(far.path, TALKER, "0.02"):
            wait_for_graph_of(daemon.path, lambda graph: graph.publishers_of("/topic"))
            assert bus("topic", "list").out.splitlines().count("/topic") == 1
            result = bus("topic", "echo", "/topic", "--once")
            assert re.match("data: 'Hello World: [0-9]+'\n", result.out), result

    def test_who_leaves_there_leaves_here(self, daemon: Daemon, far: Daemon, joined: object) -> None:
        with script_on(far.path, LISTENER):
            wait_for_graph_of(daemon.path, shows("/minimal_subscriber"))
        wait_for_graph_of(daemon.path, lacks("/minimal_subscriber"))

    def test_status(self, daemon: Daemon, far: Daemon, joined: object) -> None:
        with script_on(far.path, TALKER, "0.02"):
            wait_for_graph_of(daemon.path, lambda graph: graph.publishers_of("/topic"))
            assert bus("topic", "echo", "/topic", "--once").code == 0
            result = bus("bridge", "status")
            assert result.code == 0 and not result.err
            assert result.out.startswith("/bridge_zenoh: zenoh, this bus is here, up ")
            assert re.search(r"^up +tcp/127.0.0.1:\d+  there$", result.out, re.MULTILINE), result.out
            assert re.search(r"^in +[1-9]\d* .* /topic$", result.out, re.MULTILINE), result.out
            assert max(map(len, result.out.splitlines())) <= 80
            assert bus("node", "list").out == "/bridge_zenoh\n/minimal_publisher (from there by zenoh)\n"
            told = json.loads(bus("bridge", "status", "--json").out)
            assert not [one for one in told["routes"] if "get_status" in one["topic"]]
            (route,) = (one for one in told["routes"] if one["topic"] == "/topic")
            assert (told["bus"], told["buses"]) == ("here", ["there"])
            assert (route["direction"], route["bus"]) == ("in", "there")
            dropped = sum(route["dropped"].values()) - route["dropped"].get("lost_on_the_way", 0)
            assert route["taken"] == route["sent"] + route["waiting"] + dropped

    def test_metrics(self, daemon: Daemon, far: Daemon, joined: object) -> None:
        pytest.importorskip("prometheus_client")
        with script_on(far.path, TALKER, "0.02"):
            wait_for_graph_of(daemon.path, lambda graph: graph.publishers_of("/topic"))
            assert bus("topic", "echo", "/topic", "--once").code == 0
            told = bus("metrics", "--once").out
        assert re.search(
            r'^busd_bridge_taken_total{bridge="/bridge_zenoh",direction="in",topic="/topic"} [1-9]',
            told,
            re.MULTILINE,
        ), told
        assert re.search(r'^busd_bridge_links{bridge="/bridge_zenoh",state="up"} [1-9]', told, re.MULTILINE)

    @pytest.mark.parametrize(("number", "name"), [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "SIGTERM")])
    def test_the_end(
        self, daemon: Daemon, far: Daemon, joined: tuple[Running, Running], number: int, name: str
    ) -> None:
        """No traceback; and the mirrors of the far side are gone."""
        here, there = joined
        with script_on(far.path, LISTENER):
            wait_for_graph_of(daemon.path, shows("/minimal_subscriber"))
            result = here.end(number)
            assert result.code == -number
            assert "Traceback" not in result.err and "ERROR" not in result.err
            wait_for_graph_of(daemon.path, lacks("/minimal_subscriber", "/bridge_zenoh"))
        there.error_line_with("bus 'here' has gone")

    def test_rules_of_the_file_that_busd_has(
        self, start_daemon: Callable[..., Daemon], far: Daemon, tmp_path: Path
    ) -> None:
        place = f"tcp/127.0.0.1:{free_port()}"
        file = tmp_path / "busd.toml"
        file.write_text(f'[bridge.zenoh]\nid = "here"\nlisten = "{place}"\ndeny = "/topic"\n')
        daemon = start_daemon("--config", str(file))
        with (
            bridge(daemon.path, "zenoh"),
            bridge(far.path, "zenoh", "--connect", place),
            script_on(far.path, LISTENER),
        ):
            wait_for_graph_of(daemon.path, shows("/minimal_subscriber"))
            with script_on(far.path, LISTENER.replace('"topic"', '"other"')):
                graph = wait_for_graph_of(daemon.path, lambda graph: graph.subscriptions_of("/other"))
            assert not graph.subscriptions_of("/topic")


@pytest.mark.skipif(find_spec("cyclonedds") is None, reason="needs cyclonedds")
def test_ros_2_begins_tells_and_ends(daemon: Daemon) -> None:
    """Without a ROS 2 node; tests with rclpy check the messages."""
    with bridge(daemon.path, "ros2", "--domain-id", DOMAIN) as running:
        running.error_line_with(f"in ROS 2's domain {DOMAIN} on DDS, this machine only")
        result = bus("bridge", "status")
        assert (result.err, result.code) == ("", 0)
        assert result.out.startswith(f"/bridge_ros2_{DOMAIN}: ros2, this bus is ")
        ended = running.end(signal.SIGINT)
        assert ended.code == -signal.SIGINT
        assert "Traceback" not in ended.err and "WARN" not in ended.err
    wait_for_graph_of(daemon.path, lacks(f"/bridge_ros2_{DOMAIN}"))


def test_bridges_to_two_domains_of_ros_2(daemon: Daemon) -> None:
    domains = sorted([DOMAIN, str(int(DOMAIN) + 100)])  # the domains of `own_domain` are below 100
    with ExitStack() as stack:
        for domain in domains:
            words = ("ros2", "--domain-id", domain, "--carrier", "rtps")
            running = stack.enter_context(bridge(daemon.path, *words))
            running.error_line_with(f"in ROS 2's domain {domain} on DDS, this machine only")
        result = bus("bridge", "status", "--json")
        assert (result.err, result.code) == ("", 0)
    answers = [json.loads(line) for line in result.out.splitlines()]
    assert sorted(one["node"] for one in answers) == [f"/bridge_ros2_{domain}" for domain in domains]
    assert sorted(one["links"][0]["bus"] for one in answers) == [f"dds{domain}" for domain in domains]


class TestMistakes:
    @needs_zenoh
    @pytest.mark.parametrize(
        ("words", "said"),
        [
            (["--listn", "tcp/127.0.0.1:1"], "did you mean '--listen'?"),
            (["--allow", "topic", "--listen", "tcp/127.0.0.1:1"], "--allow = 'topic' can never match"),
            (["--namespace", "1x", "--listen", "tcp/127.0.0.1:1"], "must not have a token that starts"),
            (["--id", "a b", "--listen", "tcp/127.0.0.1:1"], "the id of a bus"),
            (["--config", "/nowhere.toml"], "/nowhere.toml: can't be read: No such file"),
            (["--router", "tcp/127.0.0.1:1", "--listen", "tcp/127.0.0.1:1"], "can't be given together"),
            (["--listen", "127.0.0.1:7447"], "must begin with tls/, quic/ or tcp/"),
            (["--listen", "tcp/0.0.0.0:7447"], "is not protected"),
            (["--listen", "tls/0.0.0.0:7447"], "needs certificates for both sides"),
        ],
    )
    def test_one_sentence(self, daemon: Daemon, words: list[str], said: str) -> None:
        result = bus("bridge", "zenoh", *words)
        assert said in result.err
        assert result.code in (1, 2) and not result.out

    @needs_zenoh
    def test_a_mistake_in_busd_s_file(self, start_daemon: Callable[..., Daemon], tmp_path: Path) -> None:
        file = tmp_path / "busd.toml"
        file.write_text("[bridge.zenoh]\nlisen = 'tcp/127.0.0.1:7447'\n")
        start_daemon("--config", str(file))
        assert bus("bridge", "zenoh") == (
            "",
            f"{file}: unknown key 'bridge.zenoh.lisen'; did you mean 'listen'?\n",
            1,
        )

    @needs_zenoh
    def test_a_port_in_use(self, daemon: Daemon, far: Daemon) -> None:
        place = f"tcp/127.0.0.1:{free_port()}"
        with bridge(daemon.path, "zenoh", "--listen", place) as first:
            first.error_line_with("listening on")
            result = bus("bridge", "zenoh", "--listen", place, "--socket", str(far.path))
        assert result.err.endswith(f"\ncan't listen on {place}: address already in use\n")
        assert result.code == 1 and "Traceback" not in result.err

    @needs_zenoh
    def test_too_few_descriptors(self, daemon: Daemon) -> None:
        """Otherwise zenoh would abort the process with a backtrace."""
        script = "import resource, sys; resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40)); "
        script += "from bus_cli.main import main; sys.argv[0] = 'bus'; main()"
        place = f"tcp/127.0.0.1:{free_port()}"
        done = subprocess.run(
            [sys.executable, "-c", script, "bridge", "zenoh", "--listen", place],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        assert done.stderr.endswith("this program may open 40 files (ulimit -n); zenoh needs 64\n"), done
        assert done.returncode == 1

    def test_no_bridge_runs(self, daemon: Daemon) -> None:
        result = bus("bridge", "status")
        assert result == (
            "",
            "no bridge runs on this bus; `bus bridge zenoh` and `bus bridge ros2` start one\n",
            1,
        )

    @pytest.mark.parametrize(
        ("module", "words", "said"),
        [
            (
                "zenoh",
                ["zenoh"],
                "a bridge to zenoh needs eclipse-zenoh: pip install 'eclipse-zenoh>=1.10,<2'\n",
            ),
            (
                "cyclonedds",
                ["ros2", "--carrier", "cyclonedds"],
                "the carrier cyclonedds is missing: a bridge to ros2 is faster with cyclonedds: ",
            ),
        ],
    )
    def test_a_missing_extra(self, daemon: Daemon, module: str, words: list[str], said: str) -> None:
        block = f"import sys; sys.modules[{module!r}] = None; from bus_cli.main import main; main()"
        with Running(("-c", block, "bridge", *words)) as running:
            result = running.end()
        *log, last = result.err.splitlines(keepends=True)
        assert last.startswith(said) and all(line.startswith("[INFO]") for line in log)
        assert result.code == 1
