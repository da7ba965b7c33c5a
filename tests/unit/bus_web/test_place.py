"""Addresses on which servers may listen."""

from argparse import ArgumentTypeError
from pathlib import Path

import pytest

from bus_web.place import DEFAULT, Place, parse_address, parse_place
from rows import for_each


@for_each(
    ("text", "place", "authority"),
    [
        ("127.0.0.1:8765", DEFAULT, "127.0.0.1:8765"),
        ("localhost:0", Place("127.0.0.1", 0), "127.0.0.1:0"),
        ("[::1]:65535", Place("::1", 65535), "[::1]:65535"),
        ("127.3.2.1:80", Place("127.3.2.1", 80), "127.3.2.1:80"),
        ("unix:/run/x.sock", Place(path=Path("/run/x.sock")), "127.0.0.1:8765"),
        ("unix:/run/\u00e9", Place(path=Path("/run/\u00e9")), "127.0.0.1:8765"),
    ],
)
def test_places(text: str, place: Place, authority: str) -> None:
    assert parse_place(text) == place
    assert place.authority == authority


@for_each(
    ("text", "says"),
    [
        ("8765", "neither address:port, such as 127.0.0.1:8765, nor unix:PATH"),
        ("", "neither"),
        (":8765", "neither"),
        ("localhost:65536", "neither"),
        ("localhost:00000099999", "neither"),
        ("localhost:-1", "neither"),
        ("localhost:", "neither"),
        ("example.org:80", "'example.org' is not a loopback address"),
        ("0.0.0.0:8765", "0.0.0.0 is not loopback; .* run: ssh -NL 8765:127.0.0.1:8765 HOST"),
        ("192.168.1.7:9000", "is not loopback; .* run: ssh -NL 9000:127.0.0.1:9000 HOST"),
        ("[::]:0", "is not loopback; .* ssh -NL 8765:127.0.0.1:8765 HOST"),
        ("unix:", "write unix:PATH"),
        ("unix:/" + "x" * 107, "107 bytes at most; this one has 108"),
        ("unix:/a\0b", "can.t be printed"),
        ("unix:/a\nb", "can.t be printed"),
        ("unix:/a\x1b[31m", r"'/a\\x1b\[31m'"),
        ("unix:/a\udcff", "can.t be printed"),
        ("unix:~nobody-of-this-name/x", "unix:~nobody-of-this-name/x: there is no such user"),
    ],
)
def test_what_is_no_place(text: str, says: str) -> None:
    with pytest.raises(ArgumentTypeError, match=says):
        parse_place(text)


METRICS = Place("127.0.0.1", 9464)


@for_each(
    ("text", "says"),
    [
        ("9464", "'9464' is not address:port, such as 127.0.0.1:9464"),
        ("unix:/run/x.sock", "'unix:/run/x.sock' is not address:port"),
        ("127.0.0.1:99999999999999999999", "is not address:port"),
        ("0.0.0.0:0", "0.0.0.0 is not loopback; metrics are private. .* ssh -NL 9464:127.0.0.1:9464 HOST"),
    ],
)
def test_addresses_of_other_servers(text: str, says: str) -> None:
    assert parse_address("[::1]:1", METRICS, "metrics are private") == Place("::1", 1)
    with pytest.raises(ArgumentTypeError, match=says):
        parse_address(text, METRICS, "metrics are private")


def test_a_relative_path_is_of_this_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    place = parse_place("unix:web.sock")
    assert place.path == tmp_path / "web.sock"
    assert place.forwarding == f"ssh -NL 8765:{tmp_path}/web.sock HOST"
    assert str(place) == f"unix:{tmp_path}/web.sock"


def test_servers_of_one_machine_have_cookies_of_their_own() -> None:
    names = {parse_place(text).cookie for text in ("127.0.0.1:1", "127.0.0.1:2", "unix:/a", "unix:/b")}
    assert len(names) == 4
    assert parse_place("localhost:1").cookie in names, "the same after a restart"
    names = {Place("127.0.0.1", port).cookie for port in range(40_000, 50_000)}
    assert len(names) == 64, "servers on any port, one after the other, leave few cookies in a browser"
