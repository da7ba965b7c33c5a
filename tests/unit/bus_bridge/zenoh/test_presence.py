"""The buses present, found from tokens in any order."""

from itertools import permutations

import pytest

from bus.qos import QoSProfile
from bus_bridge.engine import FarBus, FarEndpoint, FarNode, LocalEndpoint, LocalNode
from bus_bridge.zenoh import keys, presence
from bus_bridge.zenoh.groups import Groups, write_run
from bus_bridge.zenoh.presence import Interest, Presence
from rows import for_each

GID = bytes(range(16))
NODE = LocalNode(4, "talker", "/", ("robot",))


class Heard:
    """A FarSide that records its calls."""

    def __init__(self, run: str = "5") -> None:
        self.news: list[tuple[object, ...]] = []
        self.interests: list[bytes] = []
        self.presence = Presence("laptop", run, self, self.interests.append)

    def bus_added(self, bus: FarBus) -> None:
        self.news.append(("bus", bus.id))

    def bus_removed(self, bus_id: str, reason: str) -> None:
        self.news.append(("no bus", bus_id, reason))

    def node_added(self, node: FarNode) -> None:
        self.news.append(("node", node.key))

    def node_removed(self, key: str) -> None:
        self.news.append(("no node", key))

    def endpoint_added(self, endpoint: FarEndpoint) -> None:
        self.news.append((endpoint.kind, endpoint.node))

    def endpoint_removed(self, gid: bytes, node: str) -> None:
        self.news.append(("no endpoint", gid, node))

    def warn(self, text: str) -> None:
        self.news.append(("warning", text))

    def take(self) -> list[tuple[object, ...]]:
        news, self.news = self.news, []
        return news


@pytest.fixture
def heard() -> Heard:
    return Heard()


def tokens(bus: str = "robot", run: str = "1") -> dict[str, str]:
    qos = QoSProfile(10)
    ends = {
        kind: LocalEndpoint(kind, GID[:15] + number, NODE, "/a", "p/msg/T", "h", qos)  # type: ignore[arg-type]
        for kind, number in (("publisher", b"p"), ("subscription", b"s"))
    }
    return {
        "bus": keys.bus_token(bus, run, "f00"),
        "node": keys.node_token(bus, run, NODE),
        **{kind: keys.endpoint_token(bus, run, end) for kind, end in ends.items()},
    }


def test_a_bus_is_told_before_its_nodes_and_a_node_before_its_endpoints() -> None:
    for order in permutations(tokens().values()):
        heard = Heard()
        for key in order:
            heard.presence.came(key)
        news = heard.take()
        assert sorted(map(str, news)) == sorted(
            map(
                str,
                [
                    ("bus", "robot"),
                    ("node", "robot/1/4"),
                    ("publisher", "robot/1/4"),
                    ("subscription", "robot/1/4"),
                ],
            )
        )
        assert news[0] == ("bus", "robot") and news[1] == ("node", "robot/1/4")


def test_subscriptions_are_told_before_publishers(heard: Heard) -> None:
    known = tokens()
    for what in ("publisher", "subscription", "node", "bus"):
        heard.presence.came(known[what])
    assert [one[0] for one in heard.take()] == ["bus", "node", "subscription", "publisher"]


def test_what_goes_is_told_once(heard: Heard) -> None:
    known = tokens()
    for key in known.values():
        heard.presence.came(key)
        heard.presence.came(key)
    assert len(heard.take()) == 4
    heard.presence.went(known["publisher"])
    heard.presence.went(known["publisher"])
    heard.presence.went(known["node"])
    heard.presence.went(known["subscription"])
    assert heard.take() == [("no endpoint", GID[:15] + b"p", "robot/1/4"), ("no node", "robot/1/4")]
    heard.presence.went(known["bus"])
    assert [one[:2] for one in heard.take()] == [("no bus", "robot")]
    assert heard.presence.buses() == []


def test_a_bridge_that_started_anew_takes_the_place_of_what_it_was(heard: Heard) -> None:
    old, new = tokens(run="1"), tokens(run="2")
    for key in (*old.values(), new["publisher"], new["node"], new["bus"]):
        heard.presence.came(key)
    heard.presence.poll({"f00": ""})
    assert len(heard.take()) == 4
    for key in old.values():
        heard.presence.went(key)
    assert heard.take() == [
        ("no bus", "robot", "its bridge has gone, or can't be reached"),
        ("bus", "robot"),
        ("node", "robot/2/4"),
        ("publisher", "robot/2/4"),
    ]
    assert heard.presence.bus_of("robot/2/4") == "robot" and heard.presence.bus_of("robot/1/4") is None


@pytest.mark.parametrize("linked", [None, {"f00": ""}])
@pytest.mark.parametrize("run", ["0", "2"])
def test_who_claims_the_id_of_another_bus_is_not_heard(
    heard: Heard, run: str, linked: dict[str, str] | None
) -> None:
    for key in tokens().values():
        heard.presence.came(key)
    for key in tokens(run=run).values():
        heard.presence.came(key)
    assert len(heard.take()) == 4
    for _ in range(presence._PATIENCE):
        heard.presence.poll(linked)
    assert heard.take() == []  # it may be the rest of an earlier run, or wait for that rest
    for _ in range(3):
        heard.presence.poll(linked)
    text = (
        "two buses have the id 'robot', and this bridge uses the first one: give the other one another id "
        "with --id"
    )
    assert heard.take() == [("warning", text)]
    assert [one[2] for one in heard.presence.buses()] == [
        "",
        "another bus has the id 'robot', and came first",
    ]
    heard.presence.went(tokens()["bus"])
    heard.presence.came(tokens(run="3")["bus"])  # of the first one, which is back
    assert [one[0] for one in heard.take()] == ["no bus", "bus"]
    assert heard.presence._heard["robot"].run == "3"


@pytest.mark.parametrize(
    ("linked", "reason"),
    [
        ({"f01": "", "f02": ""}, ""),
        ({"f01": "a", "f02": "b"}, ""),
        ({"f01": "a", "f02": "a", "f00": "a"}, "its bridge has restarted"),
        ({"f02": ""}, "no link leads to it any more"),
    ],
)
def test_links_tell_that_one_is_there_no_more(heard: Heard, linked: dict[str, str], reason: str) -> None:
    for run in ("1", "2", "0"):
        heard.presence.came(keys.bus_token("robot", run, f"f0{run}"))
    heard.take()
    for _ in range(3):
        heard.presence.poll(linked)
    assert heard.take() == ([("no bus", "robot", reason), ("bus", "robot")] if reason else [])
    assert heard.presence._heard["robot"].run == ("2" if reason else "1")
    heard.presence.went(keys.bus_token("robot", "1", "f01"))
    assert heard.presence._heard["robot"].run == "2"


def test_what_is_wrong_with_one_run_is_held_against_no_other(heard: Heard) -> None:
    for key in (*tokens().values(), tokens(run="2")["bus"]):
        heard.presence.came(key)
    heard.take()
    for key in (
        "@busd/3/robot/N/2/5/bad%00name/%2F/,",
        "@busd/3/robot/N/3/5/x",
        "@busd/3/robot",
        "@busd/3/robot/N/2",
    ):
        heard.presence.came(key)
    heard.presence.refuse("robot", "it shows too much", "2")
    heard.presence.refuse("robot", "it shows too much", "4")
    assert [one[0] for one in heard.take()] == ["warning", "warning"]
    assert [bool(refusal) for _, _, refusal in heard.presence.buses()] == [False, True]


def test_what_is_left_of_an_earlier_run_is_not_heard(heard: Heard) -> None:
    heard.presence.came(tokens(run="2")["bus"])
    for key in tokens(run="1").values():
        heard.presence.came(key)
    assert heard.take() == [("bus", "robot")]
    heard.presence.went(tokens(run="2")["bus"])
    assert [one[0] for one in heard.take()] == ["no bus", "bus", "node", "subscription", "publisher"]


def test_a_token_that_cannot_be_read_is_ignored_alone(heard: Heard) -> None:
    """Any bridge can write it, with the run of another one."""
    for key in tokens().values():
        heard.presence.came(key)
    heard.take()
    bad = "@busd/3/robot/N/1/5/bad%00name/%2F/,"
    heard.presence.came(bad)
    heard.presence.came("@busd/3/robot/N/7/5/bad%00name/%2F/,")  # a run that is not there
    heard.presence.went(bad)
    text = f"a token of bus 'robot' is ignored: its token {bad} has a character that can't be printed"
    assert heard.take() == [("warning", text)]
    assert heard.presence.buses() == [("robot", "f00", "")]


@for_each(
    ("node", "topic", "reason"),
    [
        (LocalNode(5, "bad name", "/"), "", "an invalid node name"),
        (LocalNode(5, "node", "bad"), "", "an invalid node name"),
        (LocalNode(5, "node", "/", ("x" * 300,)), "", "the id of a bus that a node came through"),
        (NODE, "/bad name", "an invalid topic name"),
    ],
)
def test_a_token_with_false_names_is_ignored_alone(node: LocalNode, topic: str, reason: str) -> None:
    heard = Heard()
    for key in tokens().values():
        heard.presence.came(key)
    heard.take()
    end = LocalEndpoint("publisher", bytes(16), node, topic, "p/msg/T", "h", QoSProfile(1))
    key = keys.endpoint_token("robot", "1", end) if topic else keys.node_token("robot", "1", node)
    heard.presence.came(key)
    heard.presence.went(key)
    ((what, text),) = heard.take()
    assert what == "warning" and str(text).startswith(f"a token of bus 'robot' is ignored: {reason}")


def test_tokens_of_strangers_replace_and_remove_nothing_of_a_bus_that_is_there(heard: Heard) -> None:
    known, node = tokens(), LocalNode(4, "other", "/", ())
    for key in known.values():
        heard.presence.came(key)
    heard.take()
    forged = [keys.bus_token("robot", "1", "f66"), keys.node_token("robot", "1", node)]
    for kind in ("publisher", "subscription"):
        gid = GID[:15] + kind[:1].encode()
        end = LocalEndpoint(kind, gid, node, "/b", "p/msg/T", "h", QoSProfile(1))  # type: ignore[arg-type]
        forged.append(keys.endpoint_token("robot", "1", end))
    for key in forged:
        heard.presence.came(key)
    heard.presence.came(keys.bus_token("robot", "2", "f67"))
    heard.presence.poll({"f00": "", "f66": "", "f67": ""})
    heard.presence.poll({"f00": "", "f67": ""})
    for key in forged:
        heard.presence.went(key)
    assert heard.take() == [] and heard.presence.buses() == [("robot", "f00", ""), ("robot", "f67", "")]
    assert heard.presence.bus_of("robot/1/4") == "robot"
    heard.presence.went(known["publisher"])
    heard.presence.went(known["node"])
    assert [one[0] for one in heard.take()] == ["no endpoint", "no node"]


def test_a_refused_bus_is_not_heard_until_its_bridge_comes_back(heard: Heard) -> None:
    for key in tokens().values():
        heard.presence.came(key)
    heard.take()
    heard.presence.refuse("robot", "too many types")
    assert heard.take() == [("no bus", "robot", "too many types")]
    assert heard.presence.buses() == [("robot", "f00", "too many types")]
    for key in tokens().values():
        heard.presence.came(key)
    assert heard.take() == []
    heard.presence.came(tokens(run="2")["bus"])
    assert heard.take() == [("bus", "robot")]


def test_a_bus_has_so_many_tokens_and_no_more(heard: Heard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "MAX_TOKENS", 3)
    for key in tokens().values():
        heard.presence.came(key)
    assert heard.take()[-1] == ("no bus", "robot", "it has announced more than 3 tokens")


def test_there_are_so_many_bridges_and_no_more(heard: Heard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "MAX_RUNS", 3)
    for number in range(10):  # none of them shows itself
        heard.presence.came(tokens(f"robot{number}")["node"])
    assert heard.take() == []
    for number in range(3):
        heard.presence.came(tokens(f"robot{number}")["bus"])
    assert len(heard.take()) == 3
    heard.presence.came(tokens("robot3")["bus"])
    assert heard.take() == [("warning", "more than 3 bridges announce themselves; further ones are ignored")]
    heard.presence.went(tokens("robot1")["bus"])
    heard.take()
    heard.presence.came(tokens("robot3")["bus"])
    assert heard.take() == [("bus", "robot3")]


def test_who_takes_what_we_send(heard: Heard) -> None:
    heard.presence.came(tokens()["bus"])
    ours, theirs = (keys.interest_token("robot", "1", of, GID) for of in ("laptop", "other"))
    heard.presence.came(theirs)
    heard.presence.came(ours)
    heard.presence.came(ours)
    assert heard.interests == [GID] and heard.presence.interests(GID) == {Interest("robot", "1")}
    heard.presence.came(keys.interest_token("second", "1", "laptop", GID))
    heard.presence.refuse("robot", "why not")
    assert heard.presence.interests(GID) == {Interest("second", "1")}
    heard.presence.went(keys.interest_token("second", "1", "laptop", GID))
    assert heard.presence.interests(GID) == frozenset()
    assert heard.interests == [GID] * 4


def test_own_tokens_are_no_news_but_those_of_a_double_are_known(heard: Heard) -> None:
    heard.presence.came(keys.bus_token("laptop", "5", "f00"))
    # At once if it is the later one, or if it has a link to us. Otherwise, it may be the rest of our earlier
    # run.
    for run, linked, looks in (("6", "", 1), ("4", "f00", 1), ("4", "", presence._PATIENCE + 1)):
        heard.presence.poll({linked: ""})
        assert heard.take() == []
        heard.presence.came(keys.bus_token("laptop", run, "f00"))
        assert heard.presence.doubles == ["f00"]
        for _ in range(looks):
            assert heard.take() == []
            heard.presence.poll({linked: ""})
        ((_, text),) = heard.take()
        assert text == (
            "another bus has the id 'laptop' too, so neither sees the other: give one of them another id "
            "with --id"
        )
        heard.presence.went(keys.node_token("laptop", run, LocalNode(1, "talker", "/")))
        assert heard.presence.doubles
        heard.presence.went(keys.bus_token("laptop", run, "f00"))
        assert not heard.presence.doubles


def test_another_version_is_said(heard: Heard) -> None:
    heard.presence.came("@busd/9/robot/B/1/2")
    heard.presence.went("@busd/9/robot/B/1/2")
    ((_, text),) = heard.take()
    assert text == (
        "bus 'robot' speaks version 9 of the bridges' protocol, this one version 3: "
        "use the same busd on both sides"
    )


@for_each(
    ("own", "theirs", "is_seen"),
    [
        (Groups(), Groups("robots"), True),
        (Groups("operators"), Groups("robots", ("operators",)), True),
        (Groups("robots"), Groups("robots", ("operators",)), False),
        (Groups(), Groups("robots", ("operators",)), False),
    ],
)
def test_a_bus_that_does_not_see_this_one_is_refused(own: Groups, theirs: Groups, is_seen: bool) -> None:
    heard = Heard(write_run(own, "5"))
    run = write_run(theirs, "1")
    for key in tokens(run=run).values():
        heard.presence.came(key)
    assert bool(heard.take()) is is_seen
    ((_, _, refusal),) = heard.presence.buses()
    assert ("its --see does not name" in refusal) is not is_seen


def test_a_bridge_that_restarts_in_another_group() -> None:
    """The older run sorts after it, but is the remains of its predecessor."""
    heard = Heard()
    old, new = write_run(Groups("z"), "1"), write_run(Groups("a"), "2")
    for run in (old, new):
        heard.presence.came(keys.bus_token("robot", run, f"f{run[-1]}"))
    heard.take()
    heard.presence.poll({"f1": "10.0.0.2", "f2": "10.0.0.2"})
    assert heard.take() == [("no bus", "robot", "its bridge has restarted"), ("bus", "robot")]


def test_bridges_that_do_not_see_this_bus_take_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "MAX_RUNS", 3)
    heard = Heard()
    blind = write_run(Groups("robots", ("operators",)), "1")
    for number in range(5):
        for key in tokens(f"robot{number}", blind).values():
            heard.presence.came(key)
    assert len(heard.presence.buses()) == 3 and heard.take() == []
    for number in range(3):
        heard.presence.came(keys.bus_token(f"other{number}", "1", "f00"))
    assert heard.take() == [("bus", f"other{number}") for number in range(3)]
