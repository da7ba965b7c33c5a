import pytest

from bus.errors import ConfigurationError
from bus_bridge.core.rules import Direction, Kind, Rules, TopicRule, kind_of, subject_of
from bus_bridge.engine import RouteRule
from rows import for_each


@for_each(
    "topic, subject",
    [
        ("/chatter", "/chatter"),
        ("/add/_request", "/add"),
        ("/add/_reply", "/add"),
        ("/fibonacci/_action/feedback", "/fibonacci"),
        ("/fibonacci/_action/status", "/fibonacci"),
        ("/fibonacci/_action/send_goal/_request", "/fibonacci"),
        ("/fibonacci/_action/get_result/_reply", "/fibonacci"),
        ("/fibonacci/_action/other", "/fibonacci/_action/other"),
        ("/_request", "/_request"),
    ],
)
def test_the_subject_is_what_users_call_it(topic: str, subject: str) -> None:
    assert subject_of(topic) == subject


@for_each(
    "allow, deny, topic, crosses",
    [
        ([], [], "/chatter", True),
        ([], [], "/a/b/_request", True),
        ([], [], "/a/b/_reply", True),
        ([], [], "/fibonacci/_action/feedback", True),
        ([], [], "/fibonacci/_action/cancel_goal/_request", True),
        ([], [], "/rosout", False),
        ([], [], "/parameter_events", False),
        ([], [], "/_hidden", False),
        ([], [], "/a/_hidden/b", False),
        ([], [], "/a/_hidden/_request", False),
        (["/chatter"], [], "/chatter", True),
        (["/chatter"], [], "/chatter2", False),
        (["/camera/*"], [], "/camera/left", True),
        (["/camera/*"], [], "/camera/left/raw", False),
        (["/camera/**"], [], "/camera/left/raw", True),
        (["/add"], [], "/add/_request", True),
        (["/add"], [], "/add/_reply", True),
        (["/add"], [], "/added/_reply", False),
        (["/fibonacci"], [], "/fibonacci/_action/status", True),
        (["/**"], [], "/rosout", False),
        (["/rosout"], [], "/rosout", True),
        (["/**", "/rosout"], [], "/parameter_events", False),
        (["/**"], [], "/_hidden", False),
        (["/_hidden"], [], "/_hidden", True),
        (["/a/_*"], [], "/a/_hidden", True),
        (["/chatter"], ["/chatter"], "/chatter", False),
        (["/rosout"], ["**"], "/rosout", False),
        ([], ["/camera/**"], "/camera/left", False),
        ([], ["/add"], "/add/_reply", False),
        ([], ["/camera/**"], "/chatter", True),
    ],
)
def test_what_crosses(allow: list[str], deny: list[str], topic: str, crosses: bool) -> None:
    crossing = Rules(allow, deny).crossing(topic)
    assert (crossing.goes_out, crossing.comes_in) == (crosses, crosses)


@for_each(
    "direction, topic, goes_out, comes_in",
    [
        ("both", "/chatter", True, True),
        ("out", "/chatter", True, False),
        ("in", "/chatter", False, True),
        ("out", "/chatter/_request", False, True),
        ("out", "/chatter/_reply", True, False),
        ("in", "/chatter/_request", True, False),
        ("in", "/chatter/_reply", False, True),
        ("out", "/chatter/_action/feedback", True, False),
        ("out", "/chatter/_action/send_goal/_request", False, True),
    ],
)
def test_directions(direction: Direction, topic: str, goes_out: bool, comes_in: bool) -> None:
    crossing = Rules(topics=[TopicRule(pattern="/chatter", direction=direction)]).crossing(topic)
    assert (crossing.goes_out, crossing.comes_in) == (goes_out, comes_in)


def test_the_last_rule_that_says_something_counts() -> None:
    rules = Rules(
        topics=[
            TopicRule(pattern="/camera/**", depth=5, max_rate_hz=10.0, priority="background"),
            TopicRule(pattern="/camera/left", max_rate_hz=30.0, transit=True),
            TopicRule(pattern="/other", depth=7, direction="in"),
        ]
    )
    left = rules.crossing("/camera/left")
    assert left.rule == RouteRule(depth=5, max_rate_hz=30.0, priority="background", transit=True)
    assert left.goes_out and left.comes_in
    assert rules.crossing("/camera/right").rule == RouteRule(depth=5, max_rate_hz=10.0, priority="background")
    assert rules.crossing("/chatter").rule == RouteRule()


def test_a_rule_alone_lets_nothing_private_cross() -> None:
    assert not Rules(topics=[TopicRule(pattern="/rosout", depth=5)]).crossing("/rosout").goes_out


def test_names_that_never_come_again_are_forgotten() -> None:
    rules = Rules(deny=["/topic_7*"])
    for number in range(30_000):
        assert rules.crossing(f"/topic_{number}").goes_out is not str(number).startswith("7")


@for_each(
    "rules, text",
    [
        ({"allow": ["chatter"]}, "allow = 'chatter' can never match"),
        ({"deny": ["/a//b"]}, "deny = '/a//b' can never match"),
        (
            {"topics": [TopicRule(pattern="a*")], "table": "bridge.zenoh"},
            "bridge.zenoh.topics.pattern = 'a*' can never match",
        ),
    ],
)
def test_patterns_that_can_never_match(rules: dict[str, object], text: str) -> None:
    with pytest.raises(ConfigurationError, match=text.replace("*", r"\*")):
        Rules(**rules)  # type: ignore[arg-type]


KINDS: dict[str, Kind] = {
    "/chatter": "topics",
    "/add/_request": "services",
    "/node/get_type_description/_reply": "services",
    "/fibonacci/_action/feedback": "actions",
    "/fibonacci/_action/get_result/_reply": "actions",
    "/node/set_parameters/_request": "parameters",
    "/node/list_parameters/_reply": "parameters",
}


@for_each("topic, kind", [*KINDS.items()])
def test_kinds(topic: str, kind: Kind) -> None:
    assert kind_of(topic) == kind


@for_each("kind", [*dict.fromkeys(KINDS.values())])
def test_rules_of_a_kind(kind: Kind) -> None:
    rules = Rules(topics=[TopicRule(pattern="/**", kind=kind, direction="none", depth=7)])
    for topic, its_kind in KINDS.items():
        crossing = rules.crossing(topic)
        is_free = its_kind != kind
        assert (crossing.goes_out, crossing.comes_in) == (is_free, is_free)
        assert crossing.rule.depth == (None if is_free else 7)


def test_parameters_of_one_side_only() -> None:
    rules = Rules(topics=[TopicRule(pattern="/**", kind="parameters", direction="in")])
    requests, replies = (rules.crossing(f"/node/set_parameters/_{end}") for end in ("request", "reply"))
    assert (requests.goes_out, requests.comes_in) == (True, False)
    assert (replies.goes_out, replies.comes_in) == (False, True)


def test_far_names() -> None:
    topics = [
        TopicRule(pattern="/scan", far_name="/front"),
        TopicRule(pattern="/**", depth=5),
        TopicRule(pattern="/add", far_name="/sum"),
        TopicRule(pattern="/scan", far_name="/front/scan"),
    ]
    rules = Rules(topics=topics)
    assert rules.far_names == {"/scan": "/front/scan", "/add": "/sum"}
    assert rules.crossing("/scan").rule == RouteRule(depth=5)


@for_each(
    ("topics", "text"),
    [
        ([TopicRule(pattern="/a/*", far_name="/b")], "'/b': its pattern must be one name, without wildcards"),
        ([TopicRule(pattern="/a", far_name="b")], "'b': Invalid topic name"),
        ([TopicRule(pattern="/a", far_name="/b c")], "'/b c': Invalid topic name"),
        (
            [TopicRule(pattern="/a/_request", far_name="/b")],
            "'/b': '/a/_request' is a part of '/a'; use that name",
        ),
        ([TopicRule(pattern="/a", far_name="/b/_action/status")], "is a part of '/b'; use that name"),
        ([TopicRule(pattern="/a", far_name="/b", kind="topics")], "such a rule can't have a 'kind'"),
        (
            [TopicRule(pattern="/a", far_name="/x"), TopicRule(pattern="/b", far_name="/x")],
            "'/x' is given to both '/a' and '/b'",
        ),
    ],
)
def test_impossible_far_names(topics: list[TopicRule], text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        Rules(topics=topics, table="bridge.ros2")
    assert text in str(caught.value)
    assert str(caught.value).startswith("bridge.ros2.topics.far_name = ") and "\n" not in str(caught.value)
