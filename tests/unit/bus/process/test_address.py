"""The path of the socket: the order of the settings that can name it, and their limits."""

from pathlib import Path

import pytest

from bus.errors import ConfigurationError
from bus.process.address import MAX_PATH_BYTES, domain_id, socket_path
from rows import for_each

RUNTIME = {"XDG_RUNTIME_DIR": "/run/user/7"}


@for_each(
    ("socket", "domain", "environ", "expected"),
    [
        ("/a/b.sock", 3, {"BUSD_SOCKET": "/c.sock", **RUNTIME}, "/a/b.sock"),
        (Path("/a/b.sock"), None, {}, "/a/b.sock"),
        (None, 3, {"BUSD_SOCKET": "/c.sock", **RUNTIME}, "/c.sock"),
        (None, None, {"BUSD_SOCKET": "", **RUNTIME}, "/run/user/7/busd/0.sock"),
        (None, 3, {"BUSD_DOMAIN": "4", **RUNTIME}, "/run/user/7/busd/3.sock"),
        (None, None, {"BUSD_DOMAIN": "4", **RUNTIME}, "/run/user/7/busd/4.sock"),
        (None, None, {}, "/tmp/busd-7/0.sock"),
        (None, 65535, {"XDG_RUNTIME_DIR": ""}, "/tmp/busd-7/65535.sock"),
        (None, None, {"XDG_RUNTIME_DIR": "relative"}, "/tmp/busd-7/0.sock"),
    ],
)
def test_who_decides(
    socket: str | Path | None, domain: int | None, environ: dict[str, str], expected: str
) -> None:
    assert socket_path(socket, domain, environ=environ, uid=7) == Path(expected)


def test_relative_socket_is_made_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert socket_path("bus.sock", environ={}) == tmp_path / "bus.sock"


def test_this_process_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSD_SOCKET", "/from/environment.sock")
    assert socket_path() == Path("/from/environment.sock")


def test_creates_nothing(tmp_path: Path) -> None:
    socket_path(environ={"XDG_RUNTIME_DIR": str(tmp_path)})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("letter", ["a", "é"])
def test_longest_path(letter: str) -> None:
    size = len(letter.encode())
    longest = "/" + "x" * ((MAX_PATH_BYTES - 1) % size) + letter * ((MAX_PATH_BYTES - 1) // size)
    assert len(longest.encode()) == 107
    assert socket_path(longest, environ={}) == Path(longest)
    with pytest.raises(ConfigurationError) as caught:
        socket_path(longest + "x", environ={})
    assert "has 108 bytes" in str(caught.value)
    assert "at most 107" in str(caught.value)
    assert "--socket or BUSD_SOCKET" in str(caught.value)


def test_a_long_runtime_folder_is_refused_too() -> None:
    with pytest.raises(ConfigurationError, match="at most 107"):
        socket_path(environ={"XDG_RUNTIME_DIR": "/" + "r" * 120})


def test_nul_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="NUL"):
        socket_path("/a\0b", environ={})


@for_each(
    ("domain", "text", "expected"),
    [(0, "9", 0), (65535, "9", 65535), (None, "9", 9), (None, " 12 ", 12), (None, "", 0), (None, "007", 7)],
)
def test_domain(domain: int | None, text: str, expected: int) -> None:
    assert domain_id(domain, environ={"BUSD_DOMAIN": text}) == expected


@for_each("domain", [-1, 65536, True, 1.0, "1"])
def test_bad_domain_argument(domain: int) -> None:
    with pytest.raises(ConfigurationError) as caught:
        domain_id(domain, environ={})
    assert str(caught.value) == f"domain must be an integer from 0 to 65535, not {domain!r}"


@for_each("text", ["-1", "65536", "abc", "1.5", "1_0", "٣", "9" * 5000])
def test_bad_domain_variable(text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        socket_path(environ={"BUSD_DOMAIN": text})
    assert str(caught.value) == f"BUSD_DOMAIN must be an integer from 0 to 65535, not '{text}'"
