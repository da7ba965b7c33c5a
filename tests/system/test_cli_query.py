"""The verbs that query the graph, against the texts of the real `ros2`, with the two nodes of the lesson."""

import re
from collections.abc import Iterator

import msgspec
import pytest

from bus.graph import Graph
from cli import LISTENER, TALKER, Result, bus, messages_on_topic, script, start, wait_for_graph

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
ENDPOINT = f"""\
Node name: {{node}}
Node namespace: /
Topic type: std_msgs/msg/String
Topic type hash: {HASH}
Endpoint type: {{kind}}
GID: <gid>
QoS profile:
  Reliability: RELIABLE
  History (Depth): KEEP_LAST (10)
  Durability: VOLATILE
  Lifespan: Infinite
  Deadline: Infinite
  Liveliness: AUTOMATIC
  Liveliness lease duration: Infinite
"""
NODE_INFO = """\
  Service Servers:

  Service Clients:

  Action Servers:

  Action Clients:

"""


@pytest.fixture
def lesson(daemon: object) -> Iterator[None]:
    """The lesson's publisher and subscriber; the publisher sends one message at once, and no second one."""
    with script(LISTENER), script(TALKER, "1000"):
        yield


GOLDEN = {
    "topic list": "/rosout\n/topic\n",
    "topic list -t": "/rosout [rcl_interfaces/msg/Log]\n/topic [std_msgs/msg/String]\n",
    "topic list -v": "Published topics:\n"
    " * /rosout [rcl_interfaces/msg/Log] 2 publishers\n"
    " * /topic [std_msgs/msg/String] 1 publisher\n"
    "\n"
    "Subscribed topics:\n"
    " * /topic [std_msgs/msg/String] 1 subscriber\n"
    "\n",
    "topic list -c": "2\n",
    "topic info /topic": "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 1\n",
    "topic info topic": "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 1\n",
    "topic type /topic": "std_msgs/msg/String\n",
    "topic find std_msgs/msg/String": "/topic\n",
    "topic find std_msgs/String": "/topic\n",
    "topic find std_msgs/msg/String -c": "1\n",
    "topic find std_msgs/msg/Int8": "",
    "topic find std_msgs/msg/Int8 -c": "0\n",
    "node list": "/minimal_publisher\n/minimal_subscriber\n",
    "node list -c": "2\n",
    "node info /minimal_publisher": "/minimal_publisher\n"
    "  Subscribers:\n"
    "\n"
    "  Publishers:\n"
    "    /rosout: rcl_interfaces/msg/Log\n"
    "    /topic: std_msgs/msg/String\n" + NODE_INFO,
    "node info /minimal_subscriber": "/minimal_subscriber\n"
    "  Subscribers:\n"
    "    /topic: std_msgs/msg/String\n"
    "  Publishers:\n"
    "    /rosout: rcl_interfaces/msg/Log\n" + NODE_INFO,
    "topic list --json -c": '{"count":2}\n',
    "topic list --json": '{"topic":"/rosout","types":["rcl_interfaces/msg/Log"],"publishers":2,'
    '"subscriptions":0}\n'
    '{"topic":"/topic","types":["std_msgs/msg/String"],"publishers":1,"subscriptions":1}\n',
    "topic info /topic --json": '{"topic":"/topic","types":["std_msgs/msg/String"],"publisher_count":1,'
    '"subscription_count":1}\n',
    "topic type /topic --json": '{"topic":"/topic","type":"std_msgs/msg/String"}\n',
    "topic find std_msgs/String --json": '{"topic":"/topic","type":"std_msgs/msg/String"}\n',
    "topic find std_msgs/String --json -c": '{"count":1}\n',
    "node list -c --json": '{"count":2}\n',
}


def test_the_lesson(lesson: None) -> None:
    assert {words: bus(*words.split()) for words in GOLDEN} == {
        words: Result(out, "", 0) for words, out in GOLDEN.items()
    }


def test_what_is_not_there(lesson: None) -> None:
    assert bus("topic", "info", "/nosuch") == Result("", "Unknown topic '/nosuch'\n", 1)
    assert bus("topic", "info", "nosuch", "-v") == Result("", "Unknown topic 'nosuch'\n", 1)
    assert bus("node", "info", "/nosuch") == Result("", "Unable to find node '/nosuch'\n", 1)
    assert bus("topic", "type", "/nosuch") == Result("", "", 1)


def wait_for_counters(*, published: int, **expected: object) -> None:
    """Wait until the publisher and the subscription of /topic have reported these counters."""

    def have_come(graph: Graph) -> bool:
        (subscription,) = graph.subscriptions_of("/topic")
        found = {name: getattr(subscription.statistics, name, None) for name in expected}
        return messages_on_topic(graph) == published and found == expected

    wait_for_graph(have_come)


def test_info_verbose(route: str, lesson: None) -> None:
    wait_for_counters(published=1, samples=1, queued=0)
    text = bus("topic", "info", "-v", "/topic").out
    assert re.sub(r"GID: ([0-9a-f]{2}\.){15}[0-9a-f]{2}\n", "GID: <gid>\n", text) == (
        "Type: std_msgs/msg/String\n"
        "\n"
        "Publisher count: 1\n"
        "\n"
        + ENDPOINT.format(node="minimal_publisher", kind="PUBLISHER")
        + f"Messages: 1 (16 B)\nDropped: 0\nMatches: 1\n  /minimal_subscriber (route: {route})\n"
        "\n"
        "Subscription count: 1\n"
        "\n"
        + ENDPOINT.format(node="minimal_subscriber", kind="SUBSCRIPTION")
        + "Messages: 1 (16 B)\nQueue: 0 of 10\nDropped: 0\nExpected: 1\nMatches: 1\n"
        f"  /minimal_publisher (route: {route})\n"
        "\n"
    )


def test_info_verbose_without_a_subscription(daemon: object) -> None:
    with script(TALKER, "1000"):
        text = bus("topic", "info", "-v", "/topic").out
    assert text.endswith("Dropped: 0\nMatches: 0\n\nSubscription count: 0\n\n")


def test_info_verbose_in_json(route: str, lesson: None) -> None:
    wait_for_counters(published=1, samples=1, queued=0)
    record = msgspec.json.decode(bus("topic", "info", "-v", "/topic", "--json").out)
    (publisher,) = record["publishers"]
    assert publisher["node"] == "/minimal_publisher"
    assert publisher["qos"]["depth"] == 10
    assert publisher["matches"] == [{"node": "/minimal_subscriber", "route": route}]
    (subscription,) = record["subscriptions"]
    assert (subscription["queued"], subscription["dropped"], subscription["expected"]) == (0, {}, 1)
    assert "expected" not in publisher


def test_info_verbose_names_what_does_not_match_and_why(lesson: None) -> None:
    words = ("topic", "echo", "/topic", "std_msgs/msg/String", "-n", "strict")
    with (
        start(*words, "--qos-durability", "transient_local") as durable,
        start("topic", "echo", "/topic", "std_msgs/msg/Int32", "-n", "other") as other,
    ):
        durable.error_line_with("incompatible QoS")
        other.error_line_with("Incompatible type")
        result = bus("topic", "info", "-v", "/topic")
    assert "  /strict (no match: ERROR: Volatile publisher and transient local subscription)\n" in result.out
    assert (
        "  /other (no match: the publisher has std_msgs/msg/String, the subscription std_msgs/msg/Int32)\n"
        in result.out
    )
    assert result.out.startswith(
        "Type: ['std_msgs/msg/Int32', 'std_msgs/msg/String']\n\nPublisher count: 1\n"
    )


KEEPER = """
import asyncio, bus
from bus.msg.std_msgs import String
async def main():
    async with bus.Node("sender") as node, bus.Node("slow") as slow:
        publisher = await node.create_publisher(String, "topic", 100)
        subscription = await slow.create_subscription(String, "topic", 10)
        for number in range(22):
            publisher.publish(String(data="x"))
        print("ready", flush=True)
        await asyncio.Event().wait()
bus.run(main())
"""


def test_info_verbose_shows_queue_and_drops(route: str, daemon: object) -> None:
    with script(KEEPER):
        wait_for_counters(published=22, queued=10, dropped={"replaced": 12})
        text = bus("topic", "info", "-v", "/topic").out
    assert "Queue: 10 of 10\nDropped: 12 (replaced: 12)\nExpected: 22\n" in text
    assert f"Matches: 1\n  /sender (route: {route})\n" in text


def test_the_tools_own_nodes_and_hidden_topics_are_hidden(lesson: None) -> None:
    with start("topic", "pub", "/_hidden", "std_msgs/msg/String") as running:
        running.line()
        assert bus("node", "list").out == "/minimal_publisher\n/minimal_subscriber\n"
        hidden = f"/_bus_cli_{running.process.pid}"
        assert bus("node", "list", "-a").out == f"{hidden}\n/minimal_publisher\n/minimal_subscriber\n"
        assert bus("topic", "list").out == "/rosout\n/topic\n"
        assert bus("topic", "list", "--include-hidden-topics").out == "/_hidden\n/rosout\n/topic\n"
        assert bus("topic", "type", "/_hidden") == Result("", "", 1)
        assert bus("topic", "type", "/_hidden", "--include-hidden-topics").out == "std_msgs/msg/String\n"
        assert bus("topic", "find", "std_msgs/String").out == "/topic\n"
        assert bus("topic", "info", "/_hidden").code == 0
        assert "/_hidden" not in bus("node", "info", hidden).out
        assert "    /_hidden: std_msgs/msg/String\n" in bus("node", "info", hidden, "--include-hidden").out


def test_nodes_of_one_name(lesson: None) -> None:
    with script(LISTENER):
        result = bus("node", "list")
        assert result.out == "/minimal_publisher\n/minimal_subscriber\n/minimal_subscriber\n"
        assert result.err == (
            "WARNING: Be aware that there are nodes in the graph that share an exact name, "
            "which can have unintended side effects.\n"
        )
        assert bus("node", "info", "/minimal_subscriber").err == (
            'There are 2 nodes in the graph with the exact name "/minimal_subscriber". '
            "You are seeing information about only one of them.\n"
        )


def test_nodes_in_json(lesson: None) -> None:
    records = [msgspec.json.decode(line) for line in bus("node", "list", "--json").out.splitlines()]
    assert [record["node"] for record in records] == ["/minimal_publisher", "/minimal_subscriber"]
    record = msgspec.json.decode(bus("node", "info", "minimal_publisher", "--json").out)
    assert record == {
        **records[0],
        "subscribers": {},
        "publishers": {"/rosout": ["rcl_interfaces/msg/Log"], "/topic": ["std_msgs/msg/String"]},
        "service_servers": {},
        "service_clients": {},
        "action_servers": {},
        "action_clients": {},
    }


def test_nothing_is_there(daemon: object) -> None:
    for words in ("topic list", "topic list -v", "topic list -t", "node list"):
        assert bus(*words.split()) == Result("", "", 0)
    assert bus("topic", "list", "-c").out == "0\n"


def test_another_domain_is_another_bus(
    lesson: None, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    monkeypatch.delenv("BUSD_SOCKET")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("run")))
    result = bus("topic", "list", "--domain", "7")
    assert result.code == 1
    assert "/busd/7.sock" in result.err
