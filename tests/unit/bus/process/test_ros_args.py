"""ROS-style arguments: the grammar, its errors, and the effect of remap rules."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus.errors import ConfigurationError
from bus.process.ros_args import (
    Arguments,
    LogLevel,
    Parameter,
    ParameterFile,
    RemapKind,
    RemapRule,
    remove_ros_args,
)
from rows import for_each


def parse(*arguments: str) -> Arguments:
    return Arguments.parse(["--ros-args", *arguments])


def test_nothing_given() -> None:
    assert Arguments.parse([]) == Arguments()
    nothing = Arguments.parse(["talker.py", "-r", "a=b", "--", "x"])
    assert nothing == Arguments(remaining=("talker.py", "-r", "a=b", "--", "x"))
    assert nothing.node_name("n") == "n"
    assert nothing.namespace("/ns", "n") == "/ns"
    assert nothing.topic("/t", "n", "/ns") == "/t"


def test_ros_arguments_end_at_two_dashes() -> None:
    arguments = Arguments.parse(
        [
            "talker.py",
            "-v",
            "--ros-args",
            "-r",
            "a:=b",
            "--",
            "file",
            "--ros-args",
            "-p",
            "x:=1",
            "--ros-args",
        ]
    )
    assert arguments.remaps == (RemapRule(RemapKind.TOPIC_OR_SERVICE, "a", "b"),)
    assert arguments.parameters == (Parameter("x", "1"),)
    assert arguments.remaining == ("talker.py", "-v", "file")


def test_remove_ros_args() -> None:
    assert remove_ros_args(["x.py", "--rate", "3", "--ros-args", "-r", "__ns:=/n", "--", "out"]) == [
        "x.py",
        "--rate",
        "3",
        "out",
    ]


def test_a_remap_rule_outside_of_ros_args_is_deprecated() -> None:
    words = ["talker.py", "-v", "a:=b", "model:=/a/x.urdf", "n:=1", "x:={node}", "--ros-args", "-r", "c:=d"]
    arguments = Arguments.parse([*words, "--", "__ns:=/e", "file"])
    assert arguments.deprecated == ("a:=b", "__ns:=/e")
    assert arguments.remaining == ("talker.py", "-v", "model:=/a/x.urdf", "n:=1", "x:={node}", "file")
    assert arguments.topic("/a", "n", "/") == "/b"
    assert arguments.topic("/c", "n", "/") == "/d"
    assert arguments.namespace("/", "n") == "/e"


@given(st.lists(st.text(max_size=8).filter(lambda text: text != "--ros-args" and ":=" not in text)))
def test_what_is_not_ros_stays(argv: list[str]) -> None:
    assert remove_ros_args(argv) == argv
    assert remove_ros_args([*argv, "--ros-args", "-r", "a:=b"]) == argv
    assert remove_ros_args(["--ros-args", "-r", "a:=b", "--", *argv]) == argv


@for_each(
    ("rule", "expected"),
    [
        ("a:=b", RemapRule(RemapKind.TOPIC_OR_SERVICE, "a", "b")),
        ("/a/b:=~/c", RemapRule(RemapKind.TOPIC_OR_SERVICE, "/a/b", "~/c")),
        ("~/a:={node}/b", RemapRule(RemapKind.TOPIC_OR_SERVICE, "~/a", "{node}/b")),
        ("talker:a:=b", RemapRule(RemapKind.TOPIC_OR_SERVICE, "a", "b", "talker")),
        ("__node:=n", RemapRule(RemapKind.NODE_NAME, "", "n")),
        ("__name:=n", RemapRule(RemapKind.NODE_NAME, "", "n")),
        ("talker:__node:=n", RemapRule(RemapKind.NODE_NAME, "", "n", "talker")),
        ("__ns:=/a/b", RemapRule(RemapKind.NAMESPACE, "", "/a/b")),
        ("__ns:=/", RemapRule(RemapKind.NAMESPACE, "", "/")),
        ("talker:__ns:=/a", RemapRule(RemapKind.NAMESPACE, "", "/a", "talker")),
        ("rostopic://a:=b", RemapRule(RemapKind.TOPIC, "a", "b")),
        ("rostopic:///a:=~/b", RemapRule(RemapKind.TOPIC, "/a", "~/b")),
        ("rosservice://~/a:=b", RemapRule(RemapKind.SERVICE, "~/a", "b")),
        ("talker:rosservice://a:=b", RemapRule(RemapKind.SERVICE, "a", "b", "talker")),
        ("rostopic:a:=b", RemapRule(RemapKind.TOPIC_OR_SERVICE, "a", "b", "rostopic")),
    ],
)
@for_each("flag", ["-r", "--remap"])
def test_remap_rules(flag: str, rule: str, expected: RemapRule) -> None:
    assert parse(flag, rule).remaps == (expected,)


@for_each(
    ("rule", "reason"),
    [
        ("foo", "expected ':=' between two names"),
        ("foo=bar", "expected ':=' between two names"),
        (":=b", "nothing stands before ':='"),
        ("a:=", "nothing stands after ':='"),
        ("n::=b", "nothing stands before ':='"),
        (":a:=b", "node name must not be empty"),
        ("a-b:=c", "topic name must not contain characters"),
        ("a:=b/", "topic name must not end with a forward slash"),
        ("a:=b//c", "repeated '/'"),
        ("a:=b:=c", "topic name must not contain characters"),
        ("a:b:c:=d", "node name must not contain characters"),
        ("__node:=a/b", "node name must not contain characters"),
        ("__ns:=a", "namespace must be absolute"),
        ("rostopic://__node:=a", "'__node' is no name of a topic"),
        ("rosservice://__ns:=/a", "'__ns' is no name of a service"),
        ("rostopic://:=a", "nothing stands before ':='"),
        ("rosaction://a:=b", "repeated '/'"),
        ("a:=rostopic://b", "topic name must not contain characters"),
        ("__ns:=/a/", "namespace must not end with a '/'"),
    ],
)
def test_bad_remap_rules(rule: str, reason: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse("-r", rule)
    assert str(caught.value).startswith(f"Couldn't parse remap rule: '-r {rule}'. Error: ")
    assert reason in str(caught.value)


@for_each(
    ("rule", "expected"),
    [
        ("rate:=10", Parameter("rate", "10")),
        ("a.b:=[1, 2]", Parameter("a.b", "[1, 2]")),
        ("talker:url:='local:x:=y'", Parameter("url", "'local:x:=y'", "talker")),
    ],
)
@for_each("flag", ["-p", "--param"])
def test_parameters(flag: str, rule: str, expected: Parameter) -> None:
    assert parse(flag, rule).parameters == (expected,)


@for_each(
    ("rule", "reason"),
    [
        ("rate", "expected ':='"),
        ("rate:=", "nothing stands after ':='"),
        ("ra-te:=1", "parameter name must be"),
        ("a..b:=1", "parameter name must be"),
        ("no-de:rate:=1", "node name must not contain"),
    ],
)
def test_bad_parameters(rule: str, reason: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse("-p", rule)
    assert str(caught.value).startswith(f"Couldn't parse parameter override rule: '-p {rule}'. Error: ")
    assert reason in str(caught.value)


def test_parameters_and_files_keep_their_order() -> None:
    assert parse("-p", "a:=1", "--params-file", "f.yaml", "-p", "a:=2").parameters == (
        Parameter("a", "1"),
        ParameterFile("f.yaml"),
        Parameter("a", "2"),
    )


def test_log_levels() -> None:
    assert parse("--log-level", "debug", "--log-level", "ns.talker:=WARN").log_levels == (
        LogLevel("DEBUG"),
        LogLevel("WARN", "ns.talker"),
    )


@for_each(
    ("value", "reason"),
    [
        ("loud", "'loud' is no severity (unset, debug, info, warn, error, fatal)"),
        ("talker:=", "'' is no severity"),
        (":=debug", "no logger stands before ':='"),
    ],
)
def test_bad_log_levels(value: str, reason: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse("--log-level", value)
    assert str(caught.value).startswith(f"Couldn't parse log level: '--log-level {value}'. Error: ")
    assert reason in str(caught.value)


def test_switches() -> None:
    assert parse().log_to_console
    off = parse("--disable-stdout-logs", "--disable-rosout-logs", "--disable-external-lib-logs")
    assert (off.log_to_console, off.log_to_rosout) == (False, False)
    on = parse("--disable-rosout-logs", "--enable-rosout-logs")
    assert on.log_to_rosout


def test_what_only_ros_2_can_obey_is_accepted() -> None:
    assert parse("-e", "/x", "--log-config-file", "f", "--log-file-name", "f") == Arguments()


@for_each(
    "flag", ["-r", "--remap", "-p", "--param", "--params-file", "--log-level", "-e", "--log-config-file"]
)
def test_flag_without_its_value(flag: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^Couldn't parse trailing {flag} flag. No .* found.$"):
        parse(flag)


def test_unknown_ros_arguments_are_named_together() -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse("--rmap", "a:=b", "-r", "c:=d", "--disable-all")
    assert str(caught.value) == "Found unknown ROS arguments: ['--rmap', 'a:=b', '--disable-all']"


def test_node_and_namespace() -> None:
    arguments = parse("-r", "cook:__node:=chef", "-r", "chef:__ns:=/kitchen", "-r", "__ns:=/hall")
    assert arguments.node_name("cook") == "chef"
    assert arguments.node_name("waiter") == "waiter"
    assert arguments.namespace("/", "chef") == "/kitchen"
    assert arguments.namespace("/", "waiter") == "/hall"


def test_first_node_rule_wins_and_is_applied_once() -> None:
    arguments = parse("-r", "__node:=b", "-r", "b:__node:=c", "-r", "__node:=d")
    assert arguments.node_name("a") == "b"


@for_each(
    ("rules", "topic", "expected"),
    [
        (["foo:=bar"], "/ns/foo", "/ns/bar"),
        (["foo:=/bar"], "/ns/foo", "/bar"),
        (["/ns/foo:=bar"], "/ns/foo", "/ns/bar"),
        (["/foo:=bar"], "/ns/foo", "/ns/foo"),
        (["~/foo:=foo"], "/ns/trudy/foo", "/ns/foo"),
        (["foo:=~/foo"], "/ns/foo", "/ns/trudy/foo"),
        (["{node}/foo:={node}"], "/ns/trudy/foo", "/ns/trudy"),
        (["foo:=bar", "bar:=baz"], "/ns/foo", "/ns/bar"),
        (["foo:=bar", "foo:=baz"], "/ns/foo", "/ns/bar"),
        (["/foo:=x", "foo:=bar"], "/ns/foo", "/ns/bar"),
        (["trudy:foo:=bar"], "/ns/foo", "/ns/bar"),
        (["other:foo:=bar"], "/ns/foo", "/ns/foo"),
        (["other:foo:=bar", "foo:=baz"], "/ns/foo", "/ns/baz"),
        (["{host}:=bar", "foo:=baz"], "/ns/foo", "/ns/baz"),
        (["__node:=foo", "__ns:=/foo"], "/ns/foo", "/ns/foo"),
    ],
)
def test_topics(rules: list[str], topic: str, expected: str) -> None:
    arguments = Arguments.parse(["--ros-args", *(word for rule in rules for word in ("-r", rule))])
    assert arguments.topic(topic, "trudy", "/ns") == expected


def test_rules_for_topics_and_for_services() -> None:
    arguments = parse("-r", "rosservice://foo:=b", "-r", "foo:=a", "-r", "rostopic://bar:=c")
    assert [arguments.topic(name, "n", "/") for name in ("/foo", "/bar")] == ["/a", "/c"]
    assert [arguments.service(name, "n", "/") for name in ("/foo", "/bar")] == ["/b", "/bar"]


def test_replacement_that_cannot_be_expanded_is_an_error() -> None:
    with pytest.raises(ConfigurationError, match="unknown substitution: "):
        parse("-r", "foo:={host}").topic("/foo", "n", "/")
