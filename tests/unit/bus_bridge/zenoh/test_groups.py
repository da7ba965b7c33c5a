"""Groups of buses: which see each other, and how a run names them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_bridge.zenoh import keys
from bus_bridge.zenoh.groups import Groups, own_part, read_run, write_run
from rows import for_each

NAMES = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", fullmatch=True)


@for_each(
    ("groups", "run"),
    [
        (Groups(), "0a1b"),
        (Groups("robots"), "robots~~0a1b"),
        (Groups("robots", ("operators",)), "robots~operators~~0a1b"),
        (Groups("", ("operators", "tools")), "~operators~tools~~0a1b"),
    ],
)
def test_runs(groups: Groups, run: str) -> None:
    assert write_run(groups, "0a1b") == run
    assert read_run(run) == groups
    assert own_part(run) == "0a1b"


@given(own=NAMES | st.just(""), seen=st.lists(NAMES, max_size=16))
def test_every_bus_with_groups_can_be_read_and_asked_for(own: str, seen: list[str]) -> None:
    groups = Groups(own, tuple(seen))
    run = write_run(groups, "0a1b")
    assert read_run(run) == groups
    token = keys.parse_token(keys.bus_token("bus", run, "f00"))
    assert isinstance(token, keys.BusToken) and token.run == run


@given(st.text(max_size=60))
def test_any_text_is_a_run(text: str) -> None:
    read_run(text)
    assert text.endswith(own_part(text))


@for_each(
    ("one", "other", "sees"),
    [
        (Groups(), Groups(), True),
        (Groups(), Groups("robots", ("operators",)), True),
        (Groups("robots", ("operators",)), Groups(), False),
        (Groups("robots", ("operators",)), Groups("operators"), True),
        (Groups("robots", ("operators",)), Groups("robots", ("operators",)), False),
        (Groups("robots", ("operators", "robots")), Groups("robots"), True),
    ],
)
def test_who_sees_whom(one: Groups, other: Groups, sees: bool) -> None:
    assert one.sees(other) is sees


def test_in_words() -> None:
    assert str(Groups("robots", ("operators", "tools"))) == "in the group 'robots', sees operators, tools"
    assert str(Groups("", ("operators",))) == "in no group, sees operators"
    assert str(Groups("robots")) == "in the group 'robots', sees all buses"


def test_the_expression_of_a_group_covers_its_tokens_only() -> None:
    zenoh = pytest.importorskip("zenoh")
    asked = zenoh.KeyExpr(keys.tokens_of("robots"))
    for run, covered in (
        ("robots~~1", True),
        ("robots~operators~~1", True),
        ("robots2~~1", False),
        ("~robots~~1", False),
        ("1", False),
    ):
        assert asked.includes(zenoh.KeyExpr(keys.bus_token("bus", run, "f00"))) is covered, run
        assert asked.includes(zenoh.KeyExpr(keys.interest_token("bus", run, "of", bytes(16)))) is covered, run
