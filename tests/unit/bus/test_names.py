"""Names: each rule with ROS's text and the place of the fault, and the expansion of names."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus import names
from bus.errors import ConfigurationError
from rows import for_each

tokens = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,7}", fullmatch=True)
paths = st.lists(tokens, min_size=1, max_size=4).map("/".join)
namespaces = st.just("/") | paths.map("/{}".format)
likely = st.text(st.sampled_from("ab_09/~{}- \n\0é"), max_size=12) | st.text(max_size=20)

VALIDATORS: list[Callable[[str], None]] = [
    names.validate_node_name,
    names.validate_namespace,
    names.validate_topic_name,
    names.validate_full_topic_name,
]


def fault(validate: Callable[[str], None], name: str) -> tuple[str, int | None]:
    """The broken rule from the error's first line, and the index of the fault."""
    with pytest.raises(ConfigurationError) as caught:
        validate(name)
    first_line = str(caught.value).splitlines()[0]
    return first_line.split(": ", 1)[1].removesuffix(":"), caught.value.index


@for_each(
    ("name", "rule", "index"),
    [
        ("", "node name must not be empty", 0),
        ("a/b", "node name must not contain characters other than alphanumerics or '_'", 1),
        ("talker-1", "node name must not contain characters other than alphanumerics or '_'", 6),
        ("é", "node name must not contain characters other than alphanumerics or '_'", 0),
        ("a\n", "node name must not contain characters other than alphanumerics or '_'", 1),
        ("1a", "node name must not start with a number", 0),
        ("a" * 256, "node name length should not exceed '255'", 254),
    ],
)
def test_bad_node_names(name: str, rule: str, index: int) -> None:
    assert fault(names.validate_node_name, name) == (rule, index)


@for_each("name", ["a", "_", "Talker_2", "_ros2cli_17", "a" * 255])
def test_good_node_names(name: str) -> None:
    names.validate_node_name(name)


@for_each(
    ("namespace", "rule", "index"),
    [
        ("", "namespace must not be empty", 0),
        ("ns", "namespace must be absolute, it must lead with a '/'", 0),
        ("/ns/", "namespace must not end with a '/', unless only a '/'", 3),
        ("//", "namespace must not end with a '/', unless only a '/'", 1),
        ("/n s", "namespace must not contain characters other than alphanumerics, '_', or '/'", 2),
        ("/a//b", "namespace must not contain repeated '/'", 3),
        ("/a/1b", "namespace must not have a token that starts with a number", 3),
        ("/" + "a" * 245, "namespace should not exceed '245'", 244),
    ],
)
def test_bad_namespaces(namespace: str, rule: str, index: int) -> None:
    assert fault(names.validate_namespace, namespace) == (rule, index)


@for_each("namespace", ["/", "/ns", "/a/b_2/_c", "/" + "a" * 244])
def test_good_namespaces(namespace: str) -> None:
    names.validate_namespace(namespace)


@for_each(
    ("name", "rule", "index"),
    [
        ("", "topic name must not be empty string", 0),
        ("7up", "topic name token must not start with a number", 0),
        ("a/7up", "topic name token must not start with a number", 2),
        ("/7up", "topic name token must not start with a number", 1),
        ("/", "topic name must not end with a forward slash", 0),
        ("a/", "topic name must not end with a forward slash", 1),
        (
            "a-b",
            "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'",
            1,
        ),
        ("a~", "topic name must not have tilde '~' unless it is the first character", 1),
        ("~a", "topic name must not have a tilde '~' that is not followed by a forward slash '/'", 1),
        ("~abc", "topic name must not have a tilde '~' that is not followed by a forward slash '/'", 1),
        ("a{node", "topic name must not have unmatched (unbalanced) curly braces '{}'", 1),
        ("node}", "topic name must not have unmatched (unbalanced) curly braces '{}'", 4),
        ("{{node}}", "substitution name must not contain characters other than alphanumerics or '_'", 1),
        ("{a/b}", "substitution name must not contain characters other than alphanumerics or '_'", 2),
        ("{a-b}", "substitution name must not contain characters other than alphanumerics or '_'", 2),
        ("a/{4b}", "substitution name must not start with a number", 3),
    ],
)
def test_bad_topics_as_typed(name: str, rule: str, index: int) -> None:
    assert fault(names.validate_topic_name, name) == (rule, index)


@for_each("name", ["chatter", "/a/b", "~", "~/x", "{node}/x", "a{ns}", "{node}_{node}", "a4{b4}", "~/{node}"])
def test_good_topics_as_typed(name: str) -> None:
    names.validate_topic_name(name)


@for_each(
    ("name", "rule", "index"),
    [
        ("", "topic name must not be empty", 0),
        ("a", "topic name must be absolute, it must lead with a '/'", 0),
        ("/", "topic name must not end with a '/'", 0),
        ("/a/", "topic name must not end with a '/'", 2),
        ("/~", "topic name must not contain characters other than alphanumerics, '_', or '/'", 1),
        ("/a//b", "topic name must not contain repeated '/'", 3),
        ("/a/1//b", "topic name must not have a token that starts with a number", 3),
        ("/" + "a" * 247, "topic length should not exceed '247'", 246),
    ],
)
def test_bad_full_topics(name: str, rule: str, index: int) -> None:
    assert fault(names.validate_full_topic_name, name) == (rule, index)


def test_longest_full_topic() -> None:
    names.validate_full_topic_name("/" + "a" * 246)


def test_error_points_at_the_character() -> None:
    with pytest.raises(ConfigurationError) as caught:
        names.validate_topic_name("my-topic")
    assert str(caught.value) == (
        "Invalid topic name: "
        "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}':\n"
        "  'my-topic'\n"
        "     ^"
    )


def test_error_shows_one_column_for_what_cannot_be_printed() -> None:
    with pytest.raises(ConfigurationError) as caught:
        names.validate_node_name("a\nb")
    assert str(caught.value).splitlines()[1:] == ["  'a\N{REPLACEMENT CHARACTER}b'", "    ^"]


def test_error_of_a_huge_name_stays_small() -> None:
    with pytest.raises(ConfigurationError) as caught:
        names.validate_full_topic_name("/" + "a" * 1_000_000)
    assert len(str(caught.value)) < 1000


@for_each("validate", VALIDATORS)
@for_each("value", [None, 5, b"topic"])
def test_only_text_is_a_name(validate: Callable[[object], None], value: object) -> None:
    with pytest.raises(ConfigurationError, match="must be a string, not"):
        validate(value)


@pytest.mark.parametrize("validate", VALIDATORS)
@given(name=likely)
def test_a_validator_accepts_or_points_into_the_name(validate: Callable[[str], None], name: str) -> None:
    try:
        validate(name)
    except ConfigurationError as error:
        assert error.index is not None
        assert 0 <= error.index < max(1, len(name))


@for_each(
    ("name", "namespace", "full"),
    [
        ("foo", "/ns", "/ns/foo"),
        ("foo", "/", "/foo"),
        ("~", "/ns", "/ns/trudy"),
        ("~/bar", "/ns", "/ns/trudy/bar"),
        ("~/bar", "/", "/trudy/bar"),
        ("/x", "/ns", "/x"),
        ("{node}", "/ns", "/ns/trudy"),
        ("{ns}/x", "/ns", "/ns/x"),
        ("/a{namespace}", "/ns", "/a/ns"),
        ("~/{node}", "/a/b", "/a/b/trudy/trudy"),
        ("/{node}/{node}_2", "/ns", "/trudy/trudy_2"),
    ],
)
def test_expansion(name: str, namespace: str, full: str) -> None:
    assert names.expand_topic_name(name, "trudy", namespace) == full


@for_each(
    ("name", "node", "namespace", "text", "index"),
    [
        ("a/{host}", "n", "/", "Invalid topic name: unknown substitution: {host}:", 2),
        ("{}", "n", "/", "unknown substitution: {}", 0),
        ("a//b", "n", "/", "topic name must not contain repeated '/'", 3),
        ("{ns}/a", "n", "/", "'//a' (expanded from '{ns}/a')", 1),
        ("a" * 247, "n", "/", "topic length should not exceed '247'", 246),
        ("a-b", "n", "/", "Invalid topic name", 1),
        ("a", "no-de", "/", "Invalid node name", 2),
        ("a", "n", "ns", "Invalid namespace", 0),
    ],
)
def test_expansion_refused(name: str, node: str, namespace: str, text: str, index: int) -> None:
    with pytest.raises(ConfigurationError) as caught:
        names.expand_topic_name(name, node, namespace)
    assert text in str(caught.value)
    assert caught.value.index == index


@given(paths, tokens, namespaces)
def test_expansion_of_relative_names(path: str, node: str, namespace: str) -> None:
    full = names.expand_topic_name(path, node, namespace)
    assert full == names.join_node_name(namespace, path)
    assert names.expand_topic_name(full, node, namespace) == full


pieces = tokens | st.just("{node}") | tokens.map("{}_{{node}}".format)
typed_topics = st.builds(
    str.__add__, st.sampled_from(["", "/", "~/"]), st.lists(pieces, min_size=1, max_size=4).map("/".join)
)


@given(typed_topics, tokens, namespaces)
def test_expansion_gives_a_full_name_that_expands_to_itself(name: str, node: str, namespace: str) -> None:
    names.validate_topic_name(name)
    full = names.expand_topic_name(name, node, namespace)
    names.validate_full_topic_name(full)
    assert names.expand_topic_name(full, "other", "/elsewhere") == full


@given(likely, tokens, namespaces)
def test_expansion_gives_a_full_name_or_an_error(name: str, node: str, namespace: str) -> None:
    try:
        full = names.expand_topic_name(name, node, namespace)
    except ConfigurationError as error:
        assert error.index is not None
    else:
        names.validate_full_topic_name(full)


@given(namespaces, tokens)
def test_node_names_join_and_split(namespace: str, name: str) -> None:
    full = names.join_node_name(namespace, name)
    assert names.split_node_name(full) == (namespace, name)
    assert names.split_node_name(full[1:]) == (namespace, name)
    assert names.logger_name(namespace, name).split(".") == full[1:].split("/")


def test_namespace_without_its_slash() -> None:
    assert names.absolute_namespace("") == "/"
    assert names.absolute_namespace("ns") == "/ns"
    assert names.absolute_namespace("/ns") == "/ns"
    with pytest.raises(ConfigurationError, match="must not end with"):
        names.absolute_namespace("ns/")


def test_logger_names() -> None:
    assert names.logger_name("/", "talker") == "talker"
    assert names.logger_name("/a/b", "talker") == "a.b.talker"


def test_hidden() -> None:
    assert names.is_hidden_topic("/_hidden")
    assert names.is_hidden_topic("/a/_b/c")
    assert not names.is_hidden_topic("/a_/b")
    assert names.is_hidden_node("_ros2cli_1")
    assert names.is_hidden_node("/ns/_ros2cli_1")
    assert not names.is_hidden_node("/_ns/talker")
