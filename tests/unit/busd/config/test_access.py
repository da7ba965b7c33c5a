"""[socket] and [[access]] of busd.toml: names to numbers, errors, and contradictions."""

import grp
import os
import pwd
from pathlib import Path

import pytest

from bus.errors import ConfigurationError
from busd.config.access import AccessTable, SocketTable, find_doubts
from busd.config.file import Config, load
from busd.core.access import AccessRule

ROOT, ROOT_GROUP = pwd.getpwuid(0).pw_name, grp.getgrgid(0).gr_name
RULE = AccessRule(topics=("/a",), actions=frozenset({"publish"}), is_for_all=True)
DENIAL = AccessRule(topics=("/a",), actions=frozenset({"publish"}), is_for_all=True, allow=False)


def read(tmp_path: Path, text: str) -> Config:
    path = tmp_path / "busd.toml"
    path.write_text(text)
    return load(path)


def test_nothing_is_open_by_default(tmp_path: Path) -> None:
    config = read(tmp_path, "")
    assert (config.socket.mode, config.socket.gid, config.access) == (0o600, None, ())


def test_names_become_numbers(tmp_path: Path) -> None:
    config = read(
        tmp_path,
        f"""
[socket]
mode = 0o660
group = "{ROOT_GROUP}"

[[access]]
users = ["{ROOT}", 1001]
topics = "/camera/**"
actions = ["publish", "observe"]
shared_memory = false

[[access]]
groups = "{ROOT_GROUP}"
topics = ["/a", "/b/*"]
actions = "subscribe"
allow = false

[[access]]
users = "*"
topics = "**"
actions = ["observe"]
""",
    )
    assert (config.socket.mode, config.socket.gid) == (0o660, 0)
    assert config.access == (
        AccessRule(
            topics=("/camera/**",),
            actions=frozenset({"publish", "observe"}),
            uids=frozenset({0, 1001}),
            names={0: ROOT},
        ),
        AccessRule(topics=("/a", "/b/*"), actions=frozenset({"subscribe"}), gids=frozenset({0}), allow=False),
        AccessRule(topics=("**",), actions=frozenset({"observe"}), is_for_all=True),
    )


ACCESS = '[[access]]\nusers = "*"\ntopics = "/a"\nactions = "publish"\n'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (ACCESS.replace('"*"', '["rooot"]'), "access[0].users: there is no user 'rooot' on this machine"),
        (ACCESS.replace('"*"', f'["{ROOT}t"]'), f"did you mean '{ROOT}'?"),
        (ACCESS.replace('users = "*"', 'groups = "*"'), "no group '*' on this machine; '*' is for users"),
        (ACCESS.replace('"*"', "-2"), "access[0].users: -2 is not the number of a user"),
        (ACCESS.replace('"*"', "4294967295"), "access[0].users: 4294967295 is not the number of a user"),
        (ACCESS.replace('"*"', "true"), "access[0].users = True"),
        (ACCESS.replace('"*"', "[]"), "access[0]: expected either users or groups, with one entry at least"),
        (ACCESS + "groups = 7\n", "access[0]: expected either users or groups"),
        (ACCESS.replace('"/a"', "[]"), "access[0].topics: expected one entry at least"),
        (ACCESS.replace('"/a"', '"camera"'), "access[0].topics = 'camera' can never match"),
        (ACCESS.replace('"publish"', '"publsh"'), "'publsh' is not an action; did you mean 'publish'?"),
        (ACCESS.replace('"publish"', '"x"'), "'x' is not an action (known: publish, subscribe, observe)"),
        (ACCESS.replace('actions = "publish"', ""), "access[0]: 'actions' is missing"),
        (ACCESS + ACCESS.replace("topics", "topic"), "unknown key 'access[1].topic'; did you mean 'topics'?"),
        ("access = 3\n", "access: expected an array of tables, each under [[access]]"),
        ("[socket]\nmode = 660\n", "socket.mode = 660: expected 0o600, 0o660 or 0o666, in octal"),
        ("[socket]\nmode = 0o440\n", "socket.mode = 288: expected"),
        ("[socket]\nmode = 0o777\n", "socket.mode = 511: expected"),
        ('[socket]\ngroup = "robbot"\n', "socket.group: there is no group 'robbot' on this machine"),
        ("[socket]\nmod = 0o660\n", "unknown key 'socket.mod'; did you mean 'mode'?"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        read(tmp_path, text)
    assert expected in str(caught.value)
    assert str(tmp_path / "busd.toml") in str(caught.value)


def test_a_table_alone() -> None:
    table = AccessTable(topics="/a", actions=("publish",), users=5)
    assert table.rule("access[0]").uids == {5}


@pytest.mark.parametrize(
    ("mode", "folder_mode", "rules", "doubt"),
    [
        (0o600, 0o755, (), ""),
        (0o600, 0o755, (DENIAL,), ""),
        (0o600, 0o755, (RULE,), "but they can't reach"),
        (0o660, 0o700, (RULE,), "but they can't reach"),
        (0o666, 0o700, (RULE,), "but they can't reach"),
        (0o660, 0o750, (RULE,), ""),
        (0o666, 0o755, (RULE,), ""),
        (0o660, 0o750, (), "but no rule of [[access]] allows them anything"),
        (0o666, 0o711, (DENIAL,), "but no rule of [[access]] allows them anything"),
    ],
)
def test_doubts(
    tmp_path: Path, mode: int, folder_mode: int, rules: tuple[AccessRule, ...], doubt: str
) -> None:
    folder = tmp_path / "busd"
    folder.mkdir()
    path = folder / "0.sock"
    path.touch()
    path.chmod(mode)
    folder.chmod(folder_mode)
    found = find_doubts(rules, path)
    assert [doubt in text for text in found] == [True] * bool(doubt)


def test_what_earlier_versions_had_is_doubted(tmp_path: Path) -> None:
    """A file that was valid in an earlier release does not keep busd from starting."""
    config = read(tmp_path, ACCESS + ACCESS + "shared_memory = true\n")
    (doubt,) = find_doubts(config.access, tmp_path / "none")
    assert doubt.startswith("access[1].shared_memory = true has no effect any more: different users")


def test_doubts_about_an_abstract_socket() -> None:
    """An abstract socket has no mode: every process in the network namespace can reach it."""
    assert find_doubts((RULE,), Path("@busd")) == []
    assert len(find_doubts((), Path("@busd"))) == 1


def test_doubts_where_the_socket_has_gone(tmp_path: Path) -> None:
    assert find_doubts((RULE,), tmp_path / "none") == []


def test_the_group_of_the_socket_is_the_process_s_own_by_default() -> None:
    assert SocketTable(group=os.getegid()).gid == os.getegid()
