"""busd.config.file and busd.core.limits: valid keys and values, refusals, and the texts of errors."""

import ast
import inspect
import logging
import re
import string
import tomllib
from itertools import permutations
from pathlib import Path

import msgspec
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bus.errors import ConfigurationError
from bus.qos import History, QoSProfile
from busd.config.access import AccessTable, SocketTable
from busd.config.file import Config, load
from busd.core import limits as limits_module
from busd.core.limits import Limits, TopicCaps, TopicRule, rules_for
from busd.process.logs import LOG_LEVELS
from rows import for_each

DOC = Path(__file__).parents[4] / "docs" / "configuration.md"
LIMIT_FIELDS = msgspec.structs.fields(Limits)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("config") / "busd.toml"


def refusal(file: Path, text: str) -> str:
    """The error of `load` for a file with this text, without the file's name."""
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load(file)
    name, _, rest = str(caught.value).partition(": ")
    assert name == str(file)
    return rest


def test_empty_file_is_the_defaults(file: Path) -> None:
    file.write_text("")
    assert load(file) == Config() == Config(log_level="info", limits=Limits(), topics=())


def test_everything_can_be_set(file: Path) -> None:
    file.write_text(
        """
        log_level = "debug"
        [limits]
        connections = 7
        lease_s = 3
        [[topics]]
        pattern = "/camera/*"
        max_depth = 5
        [[topics]]
        pattern = "**"
        max_message_bytes = 1_000_000
        max_lifespan_s = 0.25
        """
    )
    config = load(file)
    assert config.log_level == "debug"
    assert config.limits == Limits(connections=7, lease_s=3.0)
    assert type(config.limits.lease_s) is float
    assert config.topics == (
        TopicRule(pattern="/camera/*", max_depth=5),
        TopicRule(pattern="**", max_message_bytes=1_000_000, max_lifespan_s=0.25),
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[limits]\nendpoint_per_peer = 1",
            "unknown key 'limits.endpoint_per_peer'; did you mean 'endpoints_per_peer'?",
        ),
        ("[limit]\ndepth = 1", "unknown key 'limit'; did you mean 'limits'?"),
        ("LOG_LEVEL = 'info'", "unknown key 'LOG_LEVEL'; did you mean 'log_level'?"),
        ("depth = 1", "unknown key 'depth'; did you mean 'limits.depth'?"),
        (
            "[[topics]]\npattern = '**'\n[[topics]]\nmaxdepth = 1",
            "unknown key 'topics[1].maxdepth'; did you mean 'max_depth'?",
        ),
        (
            "[[topics]]\nzzz = 1",
            "unknown key 'topics[0].zzz' (known: max_depth, max_message_bytes, max_lifespan_s, pattern)",
        ),
        ("[[topics]]\nmax_depth = 1", "topics[0]: 'pattern' is missing"),
        ("[limits]\ndepth = 'ten'", "limits.depth = 'ten': expected `int`, got `str`"),
        ("[limits]\ndepth = true", "limits.depth = True: expected `int`, got `bool`"),
        ("[limits]\ndepth = 1.5", "limits.depth = 1.5: expected `int`, got `float`"),
        ("[limits]\ndepth = 0", "limits.depth = 0: expected `int` >= 1"),
        ("[limits]\ndepth = 2147483648", "limits.depth = 2147483648: expected `int` <= 2147483647"),
        ("[limits]\nlease_s = nan", "limits.lease_s = nan: expected `float` >= 0.1"),
        ("[limits]\nlease_s = inf", "limits.lease_s = inf: expected `float` <= 86400.0"),
        (
            "[[topics]]\npattern = '**'\nmax_depth = '5'",
            "topics[0].max_depth = '5': expected `int`, got `str`",
        ),
        ("limits = 5", "limits: expected a table, got 5"),
        ("[topics]\npattern = '**'", "topics: expected an array of tables, each under [[topics]]"),
        ("topics = ['**']", "topics[0]: expected a table, got '**'"),
        ("log_level = 3", "log_level = 3: expected `str`, got `int`"),
        ("log_level = 'loud'", "log_level = 'loud': expected one of debug, info, warn, error, fatal"),
        (
            "[limits]\nqueued_bytes_per_peer = 8388608",
            "limits.message_bytes = 67108864 does not fit into limits.queued_bytes_per_peer = 8388608",
        ),
        (
            "[limits]\ndepth = 10\n[[topics]]\npattern = '**'\nmax_depth = 11",
            "topics[0].max_depth = 11 is above limits.depth = 10",
        ),
        (
            "[[topics]]\npattern = 'camera/*'",
            "topics.pattern = 'camera/*' can never match: a topic's full name begins with '/' "
            "(or begin with '**')",
        ),
    ],
)
def test_refusals(file: Path, text: str, said: str) -> None:
    assert refusal(file, text) == said


def test_syntax_error_names_the_line(file: Path) -> None:
    said = refusal(file, "log_level = 'info'\n[limits\n")
    assert said.startswith("not valid TOML: ")
    assert "line 2" in said


def test_bytes_that_are_no_text(file: Path) -> None:
    file.write_bytes(b"log_level = '\xff'")
    with pytest.raises(ConfigurationError, match=r"busd\.toml: not valid TOML: .*utf-8"):
        load(file)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"none\.toml: can't be read: No such file"):
        load(tmp_path / "none.toml")
    with pytest.raises(ConfigurationError, match=r"can't be read: Is a directory"):
        load(tmp_path)


@pytest.mark.parametrize("key", [field.name for field in LIMIT_FIELDS])
def test_a_key_with_one_letter_missing_finds_the_right_one(file: Path, key: str) -> None:
    for at in range(len(key)):
        typed = key[:at] + key[at + 1 :]
        assert refusal(file, f"[limits]\n{typed} = 1").endswith(f"did you mean '{key}'?")


toml_values = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.floats().map(repr),
    st.booleans().map(lambda value: str(value).lower()),
    st.text(string.ascii_letters, max_size=5).map(lambda value: f'"{value}"'),
    st.sampled_from(["[]", "[1]", "{}", "{ a = 1 }", "2020-01-01", "12:00:00"]),
)


@given(key=st.sampled_from([field.name for field in LIMIT_FIELDS]), value=toml_values)
def test_any_value_is_taken_as_it_is_or_refused_by_name(file: Path, key: str, value: object) -> None:
    file.write_text(f"[limits]\n{key} = {value}")
    try:
        limits = load(file).limits
    except ConfigurationError as error:
        assert f"limits.{key} = " in str(error)
    else:
        assert getattr(limits, key) == tomllib.loads(f"x = {value}")["x"]


@given(depth=st.integers(1, 2**31 - 1), lease=st.floats(0.1, 86_400))
def test_values_in_range_come_back(file: Path, depth: int, lease: float) -> None:
    file.write_text(f"[limits]\ndepth = {depth}\nlease_s = {lease!r}")
    assert load(file).limits == Limits(depth=depth, lease_s=lease)


def test_limits_are_checked_without_a_file_too() -> None:
    assert type(Limits(lease_s=3).lease_s) is float
    with pytest.raises(ConfigurationError, match=r"limits\.connections = 0: expected `int` >= 1"):
        Limits(connections=0)
    with pytest.raises(ConfigurationError, match=r"keep_all_window_bytes = 140000000 does not fit"):
        Limits(keep_all_window_bytes=140_000_000)
    with pytest.raises(ConfigurationError, match=r"schema_bytes = 9000000 does not fit"):
        Limits(schema_bytes=9_000_000)


@for_each("name", [one.name for one in LIMIT_FIELDS if one.name.endswith("_per_peer")])
def test_a_process_may_not_have_more_than_its_user(name: str) -> None:
    whole = name.replace("peer", "user")
    most = getattr(Limits(), whole)
    Limits(**{name: most})
    with pytest.raises(
        ConfigurationError, match=f"limits.{name} = {most + 1} does not fit into limits.{whole} = {most}"
    ):
        Limits(**{name: most + 1})


@for_each("level", LOG_LEVELS)
def test_logging_knows_every_level(level: str) -> None:
    assert Config(log_level=level).log_level == level
    assert level.upper() in logging.getLevelNamesMapping()


@for_each(
    ("pattern", "matching", "others"),
    [
        ("/a", ["/a"], ["/a/b", "/ab", "/x/a", "/A"]),
        ("/camera/*", ["/camera/left", "/camera/_"], ["/camera", "/camera/left/raw", "/x/camera/left"]),
        ("/camera/**", ["/camera/left", "/camera/left/raw"], ["/camera", "/camera2/left"]),
        ("**", ["/a", "/a/b/c"], []),
        ("**/image", ["/image", "/a/b/image"], ["/a/image/raw", "/a/my_images"]),
        ("/a*b", ["/ab", "/axxb"], ["/a/b", "/abc"]),
        ("/cam?", ["/cam1"], ["/cam", "/cam12"]),
        ("/a?b", ["/a_b"], ["/a/b"]),
        ("/cam[0-2x]/raw", ["/cam0/raw", "/cam2/raw", "/camx/raw"], ["/cam3/raw", "/cam/raw", "/cam-/raw"]),
        ("/cam[!0-2]", ["/cam3", "/cama"], ["/cam1", "/cam", "/cam/"]),
    ],
)
def test_patterns(pattern: str, matching: list[str], others: list[str]) -> None:
    rule = TopicRule(pattern=pattern)
    assert [topic for topic in matching + others if rule.matches(topic)] == matching


@for_each(
    ("pattern", "why"),
    [
        ("", "begins with '/'"),
        ("*", "begins with '/'"),
        ("/", "no empty part"),
        ("/a/", "no empty part"),
        ("/a//b", "no empty part"),
        ("/a b", "' ' at position 2"),
        ("/a[bc", "'[' at position 2"),
        ("/a[]", "'[' at position 2"),
        ("/a[b--c]", "'[' at position 2"),
        ("/a[z-a]", "bad character range z-a"),
        ("/a{b}", "'{' at position 2"),
        ("/a\n", "'\\n' at position 2"),
    ],
)
def test_patterns_that_can_never_match(pattern: str, why: str) -> None:
    with pytest.raises(ConfigurationError, match="can never match: .*" + re.escape(why)):
        TopicRule(pattern=pattern)


token = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
topic_names = st.lists(token, min_size=1, max_size=4).map(lambda tokens: "/" + "/".join(tokens))


@given(topic_names, topic_names)
def test_a_plain_name_is_a_pattern_for_itself_only(one: str, other: str) -> None:
    rule = TopicRule(pattern=one)
    assert rule.matches(one)
    assert rule.matches(other) == (one == other)


@given(topic_names, st.data())
def test_stars_stand_for_what_they_replace(topic: str, data: st.DataObject) -> None:
    start = data.draw(st.integers(1, len(topic)))
    end = data.draw(st.integers(start, len(topic)))
    wide = TopicRule(pattern=f"{topic[:start]}**{topic[end:]}")
    assert wide.matches(topic)
    narrow = f"{topic[:start]}*{topic[end:]}"
    assume("//" not in narrow and not narrow.endswith("/"))
    assert TopicRule(pattern=narrow).matches(topic) == ("/" not in topic[start:end])


def test_of_all_matching_rules_the_tightest_caps_hold() -> None:
    rules = (
        TopicRule(pattern="**", max_depth=100, max_message_bytes=5_000),
        TopicRule(pattern="/camera/*", max_depth=5, max_lifespan_s=2),
        TopicRule(pattern="/camera/left", max_message_bytes=9_000, max_lifespan_s=1),
        TopicRule(pattern="/imu", max_depth=1),
    )
    for order in permutations(rules):
        assert rules_for("/camera/left", order) == TopicCaps(
            max_depth=5, max_message_bytes=5_000, max_lifespan_s=1.0
        )
        assert rules_for("/other", order) == TopicCaps(max_depth=100, max_message_bytes=5_000)
    assert rules_for("/other", ()) == TopicCaps()


def test_caps_bring_a_profile_down() -> None:
    caps = TopicCaps(max_depth=5, max_lifespan_s=2.0)
    assert caps.cap(QoSProfile(depth=10)) == QoSProfile(depth=5, lifespan=2.0)
    assert caps.cap(QoSProfile(depth=3, lifespan=9.0)) == QoSProfile(depth=3, lifespan=2.0)
    assert caps.cap(QoSProfile(depth=10, history=History.KEEP_ALL)).depth == 10
    fitting = QoSProfile(depth=5, lifespan=2.0)
    assert caps.cap(fitting) is fitting
    assert TopicCaps().cap(fitting) is fitting


def documented_defaults(heading: str) -> dict[str, object]:
    """Keys and defaults of the first table after a heading of the documentation."""
    section = DOC.read_text().split(f"{heading}\n", 1)[1].split("\n#", 1)[0]
    rows = re.findall(r"^\| `(\w+)` \| (?:`([^`]+)`|(\w+)) \|", section, re.MULTILINE)
    return {key: tomllib.loads(f"x = {value}")["x"] if value else word for key, value, word in rows}


def test_documentation_has_every_key_and_default() -> None:
    assert documented_defaults("### `[limits]`") == {field.name: field.default for field in LIMIT_FIELDS}
    plain = Config()
    assert documented_defaults("## The file") == {
        "log_level": plain.log_level,
        "log_format": plain.log_format,
    }
    words = {
        field.name: "required" if field.required else "none" for field in msgspec.structs.fields(TopicRule)
    }
    assert documented_defaults("### `[[topics]]`") == words
    for heading, kind in (("### `[socket]`", SocketTable), ("### `[[access]]`", AccessTable)):
        defaults = {
            field.name: "required"
            if field.required
            else "none"
            if field.default in (None, ())
            else field.default
            for field in msgspec.structs.fields(kind)
        }
        assert documented_defaults(heading) == defaults


def test_documented_example_is_valid(file: Path) -> None:
    example = re.search(r"```toml\n(.*?)```", DOC.read_text(), re.DOTALL)
    assert example is not None
    file.write_text(example[1])
    config = load(file)
    assert rules_for("/camera/left/image_raw", config.topics) == TopicCaps(
        max_depth=5, max_message_bytes=16 * 2**20, max_lifespan_s=0.5
    )


def test_every_key_has_a_docstring() -> None:
    classes = {
        node.name: node.body
        for node in ast.parse(inspect.getsource(limits_module)).body
        if isinstance(node, ast.ClassDef)
    }
    for name in ("Limits", "TopicCaps"):
        body = classes[name]
        for at, statement in enumerate(body):
            if isinstance(statement, ast.AnnAssign):
                after = body[at + 1]
                assert isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant), statement.lineno
