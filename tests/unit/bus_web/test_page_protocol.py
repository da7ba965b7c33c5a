"""The protocol between page and server."""

from typing import Any

import msgspec
import pytest

from bus.graph import EndpointStatistics, Graph, GraphEndpoint, GraphMatch, GraphNode
from bus.qos import QoSProfile
from bus_web import page_protocol as protocol
from bus_web.model import Model
from rows import for_each

S = 1_000_000_000
TALKER = GraphNode(1, "talker", "/", 10)
LISTENER = GraphNode(2, "listener", "/", 20)


def take(model: Model, turn: int, lost: int = 0, age: Any = None) -> None:
    ends = [
        GraphEndpoint(
            3 + number, kind, node, "/chatter", "std_msgs/msg/String", "h", bytes([number]) * 16,
            QoSProfile(7),
            EndpointStatistics(
                samples=turn * 10, bytes=turn * 100, at_ns=turn * S, dropped={"replaced": lost},
                **(age or {}) if kind == "subscription" else {},
            ),
        )
        for number, (kind, node) in enumerate((("publisher", TALKER), ("subscription", LISTENER)))
    ]  # fmt: skip
    graph = Graph(1, 1, (TALKER, LISTENER), (ends[0],), (ends[1],), (GraphMatch(3, 4, "shm"),))
    model.take(graph, turn * S)


def read(frame: bytes) -> Any:
    return msgspec.json.decode(frame)


def test_the_graph() -> None:
    model = Model()
    take(model, 1)
    told = read(protocol.graph(model))
    assert told["nodes"] == [[2, "/listener", 20, False, ""], [1, "/talker", 10, False, ""]]
    assert told["topics"] == [["/chatter", ["std_msgs/msg/String"], False]]
    assert told["ends"][0] == [
        3,
        "publisher",
        1,
        "/chatter",
        "std_msgs/msg/String",
        "keep last 7, reliable",
        7,
    ]
    assert told["pairs"] == [[3, 4, "shm", ""]]


def test_rates_are_told_where_they_have_changed() -> None:
    model, sent = Model(), protocol.Sent()
    take(model, 1)
    first = read(sent.rates(model))
    assert first["topics"] == {"/chatter": [None, None, 0, 7, 0, 0, 0.0, "", None]}
    take(model, 2)
    assert read(sent.rates(model))["topics"]["/chatter"][:2] == [10.0, 100.0]
    take(model, 3)
    assert read(sent.rates(model)) == {"op": "rates", "topics": {}, "ends": {}}
    take(model, 4, lost=12)
    told = read(sent.rates(model))
    assert told["topics"]["/chatter"][4:6] == [12, 12]
    assert told["ends"]["4"][2] == 12
    again = protocol.Sent()
    assert set(read(again.rates(model))["ends"]) == {"3", "4"}, "another page has been told nothing"


def test_history_is_of_topics_with_messages() -> None:
    model = Model()
    take(model, 1)
    assert read(protocol.history(model.topics())) == {"op": "history", "topics": {}, "losses": {}}
    take(model, 2)
    take(model, 3)
    assert read(protocol.history(model.topics()))["topics"] == {"/chatter": [10.0, 10.0]}


def test_all_counters() -> None:
    model = Model()
    take(model, 2, lost=3)
    told = read(protocol.detail(model, ["/chatter", "/unknown"], 2.5))
    assert told["ends"]["4"] == [20, 200, 0, {"replaced": 3}, [], ""]
    losses = told["losses"]["/chatter"]
    assert (losses["bursts"], losses["earlier"]) == ([], {"replaced": 3}), "it is not known when"


def test_ages() -> None:
    model, sent = Model(), protocol.Sent()
    take(model, 2, age={"age_count": 5, "age_sum_ns": 10_000, "age_max_ns": 4000, "age_parts": (0, 0, 3, 2)})
    assert read(sent.rates(model))["topics"]["/chatter"][-1] == [0.00196, 0.00305]
    told = read(protocol.detail(model, ["/chatter"], 2.0))
    assert told["ages"] == {"/chatter": [[0.0015, 0.002, 3], [0.002, 0.0031, 2]]}
    take(model, 3, age={"age_count": 5, "age_sum_ns": 10_000, "age_max_ns": 4000})
    assert read(protocol.detail(Model(), [], 2.0))["ages"] == {}


def test_when_messages_were_lost() -> None:
    model = Model()
    take(model, 2)
    assert read(protocol.detail(model, ["/chatter"], 2.0))["losses"] == {}
    for turn, lost in ((3, 4), (4, 9), (30, 9), (31, 10)):
        take(model, turn, lost)
    losses = read(protocol.detail(model, ["/chatter"], 33.25))["losses"]["/chatter"]
    assert losses["bursts"] == [[30.2, 2, {"replaced": 9}], [2.2, 1, {"replaced": 1}]]
    assert (losses["width_s"], losses["earlier"], len(losses["bars"])) == (1, {}, 60)
    assert [losses["bars"][at] for at in (-31, -30, -3)] == [4, 5, 1], "a bar for each second, to 33 s"
    losses = read(protocol.detail(model, ["/chatter"], 130.0))["losses"]["/chatter"]
    assert (losses["width_s"], sum(losses["bars"])) == (3, 10)
    assert {at: n for at, n in enumerate(losses["bars"]) if n} == {17: 9, 26: 1}, "132 s are the end"
    history = read(protocol.history(model.topics()))["losses"]["/chatter"]
    assert (history[-1], history[-28], history[-29], sum(history)) == (1, 5, 4, 10)
    ends = read(protocol.detail(model, ["/chatter"], 33.25))["ends"]
    assert [ends[number][4] for number in ("3", "4")] == [[], history], "publishers are not shown"


def test_what_the_page_says() -> None:
    said = protocol.read('{"op":"look","topics":{"/a":["x.y"],"/b":[]}}')
    assert said == protocol.Look({"/a": ["x.y"], "/b": []})
    said = protocol.read('{"op":"look","topics":{"/a":["x.y"]},"plots":{"/a":["z.1","v"],"/b":[]}}')
    assert isinstance(said, protocol.Look)
    assert said.opened() == {"/a": {"x.y", "z", ""}, "/b": set()}, "an array with a plotted number is shown"
    assert protocol.read('{"op":"log","on":true}') == protocol.Log(on=True)


@for_each(
    ("frame", "says"),
    [
        ("", "not understood"),
        ("[]", "not understood"),
        ('{"op":"publish"}', "not understood"),
        ('{"op":"look"}', "not understood"),
        ('{"op":"look","topics":{"/a":[1]}}', "not understood"),
        ('{"op":"look","topics":[],"more":1}', "not understood"),
        ("[" * 10000, "not understood"),
        (b"\x00", "text frames"),
        (
            msgspec.json.encode({"op": "look", "topics": {f"/{n}": [] for n in range(33)}}).decode(),
            "33 topics watched; the limit is 32",
        ),
        (
            msgspec.json.encode(
                {"op": "look", "topics": {"/0": []}, "plots": {f"/{n}": [] for n in range(33)}}
            ).decode(),
            "33 topics watched; the limit is 32",
        ),
    ],
)
def test_what_the_page_can_not_mean(frame: str | bytes, says: str) -> None:
    with pytest.raises(protocol.Mistake, match=says):
        protocol.read(frame)
