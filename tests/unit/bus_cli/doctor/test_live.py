"""The doctor's judgement of losses that it has seen."""

from typing import Any

from bus.graph import EndpointStatistics, Graph, GraphEndpoint, GraphNode
from bus.qos import QoSProfile
from bus_cli.doctor.finding import Finding, ok, warn
from bus_cli.doctor.live import examine
from bus_web.model import Model

S = 1_000_000_000
NODE = GraphNode(1, "controller", "/", 10)


def subscription(number: int, topic: str, **counters: Any) -> GraphEndpoint:
    return GraphEndpoint(
        number, "subscription", NODE, topic, "a/msg/B", "h", number.to_bytes(16), QoSProfile(5),
        EndpointStatistics(**counters),
    )  # fmt: skip


def findings(*looks: list[GraphEndpoint]) -> list[Finding]:
    model = Model()
    for second, ends in enumerate(looks, 1):
        model.take(Graph(1, 1, (NODE,), (), tuple(ends), ()), second * S)
    return list(examine(model))


def test_nothing_is_lost() -> None:
    quiet = [subscription(1, "/a"), subscription(2, "/b", dropped={"expired": 3}, expected=5)]
    assert findings(quiet, quiet) == [ok("losses", "2 subscriptions, none lost a message in 3 s")]


def test_losses_of_now_come_first_then_advice_about_earlier_ones() -> None:
    early = subscription(1, "/a", dropped={"replaced": 20}, expected=900, most_missed=20)
    now = [subscription(2, "/b", dropped={"expired": count}, expected=900) for count in (1, 4)]
    assert findings([early, now[0]], [early, now[1]]) == [
        warn(
            "losses",
            "/b: /controller loses 3 messages a second (expired)",
            "bus topic info -v /b",
        ),
        warn(
            "losses",
            "/a: /controller has lost 20 messages (replaced)",
            "depth 5 was once too small by 20 messages: depth 25",
        ),
    ]
    assert findings([early], [early])[-1] == ok("losses", "1 subscription, none lost a message in 3 s")


def test_a_bound_of_lines() -> None:
    looks = [
        [
            subscription(number, f"/t{number}", dropped={"replaced": count}, expected=99)
            for number in range(13)
        ]
        for count in (1, 2)
    ]
    found = findings(*looks)
    assert len(found) == 11
    assert found[-1] == warn("losses", "3 further subscriptions with losses", "bus top")
