"""Rules of access: the users and topics of each rule, and the rule that decides."""

import pytest

from bus.errors import ConfigurationError
from busd.core.access import Access, AccessRule, Action, Subject
from rows import for_each

OWN, ALICE, BOB = 1000, 1001, 1002
ROBOT = 500
ALL: tuple[Action, ...] = ("publish", "subscribe", "observe")


def rule(topics: str = "**", actions: tuple[Action, ...] = ALL, **fields: object) -> AccessRule:
    return AccessRule(topics=(topics,), actions=frozenset(actions), **fields)  # type: ignore[arg-type]


def of(*uids: int) -> frozenset[int]:
    return frozenset(uids)


@for_each("uid", [OWN, 0, -1])
@for_each("action", ALL)
def test_rules_are_not_for_the_daemons_user_and_root(uid: int, action: Action) -> None:
    access = Access(OWN, (rule(is_for_all=True, allow=False),))
    assert access.is_free(uid) and access.may_connect(Subject(uid))
    assert access.decide(Subject(uid), action, "/a") == (True, 0)


@for_each("action", ALL)
def test_others_may_nothing_by_default(action: Action) -> None:
    access = Access(OWN)
    assert not access.may_connect(Subject(ALICE))
    assert access.decide(Subject(ALICE), action, "/a") == (False, 0)


def test_the_first_rule_that_matches_decides() -> None:
    access = Access(
        OWN,
        (
            rule("/camera/**", ("publish",), uids=of(BOB)),
            rule("/camera/secret", uids=of(ALICE), allow=False),
            rule("/camera/**", ("subscribe", "observe"), uids=of(ALICE)),
            rule(is_for_all=True, allow=False),
            rule(uids=of(ALICE)),
        ),
    )
    asked: list[tuple[int, Action, str]] = [
        (ALICE, "subscribe", "/camera/left"),
        (ALICE, "subscribe", "/camera/secret"),
        (ALICE, "publish", "/camera/left"),
        (ALICE, "observe", "/other"),
        (BOB, "publish", "/camera/secret"),
        (BOB, "subscribe", "/camera/left"),
    ]
    verdicts = [access.decide(Subject(uid), action, topic) for uid, action, topic in asked]
    assert [(one.is_allowed, one.rule) for one in verdicts] == [
        (True, 3),
        (False, 2),
        (False, 4),
        (False, 4),
        (True, 1),
        (False, 4),
    ]


@for_each(("gids", "is_allowed"), [({ROBOT}, True), ({7, ROBOT}, True), ({7}, False), (set(), False)])
def test_groups_are_all_that_the_process_has(gids: set[int], is_allowed: bool) -> None:
    access = Access(OWN, (rule(gids=of(ROBOT)),))
    who = Subject(ALICE, frozenset(gids))
    assert access.decide(who, "publish", "/a").is_allowed == is_allowed == access.may_connect(who)


def test_groups_that_cant_be_told_never_help() -> None:
    """If a user's groups are unknown, the user counts as in no allowed group, and in every denied group."""
    unknown = Subject(ALICE, None)
    assert not Access(OWN, (rule(gids=of(ROBOT)),)).decide(unknown, "publish", "/a").is_allowed
    denied = Access(OWN, (rule(gids=of(ROBOT), allow=False), rule(is_for_all=True)))
    assert not denied.decide(unknown, "publish", "/a").is_allowed
    assert denied.decide(Subject(ALICE, of(7)), "publish", "/a").is_allowed
    assert Access(OWN, (rule(uids=of(ALICE)),)).decide(unknown, "publish", "/a").is_allowed


def test_who_is_denied_everything_may_not_connect() -> None:
    access = Access(OWN, (rule(uids=of(ALICE), allow=False), rule("/x", ("observe",), gids=of(ROBOT))))
    assert not access.may_connect(Subject(ALICE, of(ALICE)))
    assert access.may_connect(Subject(BOB, of(BOB, ROBOT)))


def test_texts_name_user_action_topic_and_rule() -> None:
    denied = rule("/a", ("publish",), uids=of(ALICE), allow=False, names={ALICE: "alice"})
    access = Access(OWN, (denied,))
    assert access.why_not(Subject(ALICE), "publish", "/a") == (
        "user alice (uid 1001) may not publish on '/a': rule 1 of [[access]] denies it"
    )
    assert access.why_not(Subject(BOB), "subscribe", "/a") == (
        "user 1002 may not subscribe to '/a': no rule of [[access]] in busd.toml allows it"
    )
    assert "without [[access]]" in Access(OWN).why_not(Subject(BOB), "observe", "/a")
    assert access.why_turned_away(Subject(BOB, of(7, 500))) == (
        "user 1002, groups 7, 500 may not use the busd of user 1000: no rule of [[access]] allows anything; "
        "add one to its busd.toml, with users = [1002]"
    )


def test_patterns_that_can_never_match_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"access\.topics = 'camera' can never match"):
        rule("camera")


def test_what_is_remembered_is_bounded() -> None:
    access = Access(OWN, (rule("/a/*", uids=of(ALICE)),))
    for number in range(20_000):
        assert access.decide(Subject(ALICE), "publish", f"/a/x{number}").is_allowed
    assert len(access._remembered) < 20_000
