"""bus_cli.metrics.place: which places may be named, and the socket that is made there."""

import re
import socket
import stat
from argparse import ArgumentTypeError
from pathlib import Path

import pytest

from bus_cli.metrics.place import Listening, Place, parse_place
from bus_cli.output import CommandError


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("127.0.0.1:9464", Place(address="127.0.0.1", port=9464)),
        ("127.0.0.2:0", Place(address="127.0.0.2", port=0)),
        ("localhost:9464", Place(address="127.0.0.1", port=9464)),
        ("[::1]:65535", Place(address="::1", port=65535)),
        ("unix:/run/x.sock", Place(path=Path("/run/x.sock"))),
    ],
)
def test_places(text: str, expected: Place) -> None:
    assert parse_place(text) == expected


def test_a_relative_path_is_made_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert parse_place("unix:x.sock") == Place(path=tmp_path / "x.sock")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("0.0.0.0:9464", "0.0.0.0 is not loopback; metrics name processes and topics"),
        ("192.168.1.7:9464", "is not loopback"),
        ("[::]:9464", "is not loopback"),
        (":9464", "'' is no address"),
        ("example.org:9464", "'example.org' is no address"),
        ("9464", "neither unix:/path nor address:port"),
        ("127.0.0.1", "neither unix:/path nor address:port"),
        ("127.0.0.1:http", "neither unix:/path nor address:port"),
        ("127.0.0.1:65536", "neither unix:/path nor address:port"),
        ("127.0.0.1:99999999999999999999", "neither unix:/path nor address:port"),
        ("unix:", "a socket's path has 1 to 107 bytes"),
        ("unix:/" + "x" * 107, "a socket's path has 1 to 107 bytes, this one 108"),
    ],
)
def test_what_is_no_place(text: str, reason: str) -> None:
    with pytest.raises(ArgumentTypeError, match=re.escape(reason)):
        parse_place(text)


def test_on_loopback() -> None:
    with Listening(parse_place("127.0.0.1:0")) as listening:
        port = listening.socket.getsockname()[1]
        assert listening.describe() == f"http://127.0.0.1:{port}/metrics"
        assert listening.hosts == {"localhost", "127.0.0.1"}
        socket.create_connection(("127.0.0.1", port)).close()
        with pytest.raises(CommandError, match=rf"can't listen on 127.0.0.1:{port}: .*; choose another port"):
            Listening(parse_place(f"127.0.0.1:{port}"))


def test_a_socket_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    with Listening(Place(path=path)) as listening:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert listening.describe() == f"unix:{path}"
        assert not listening.hosts
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(path))
        with pytest.raises(CommandError, match="somebody listens on"):
            Listening(Place(path=path))
    assert not path.exists()


def test_a_stale_one_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    with Listening(Place(path=path)), socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))


def test_a_file_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    path.write_text("precious")
    with pytest.raises(CommandError, match="exists and is no socket; it is not replaced"):
        Listening(Place(path=path))
    assert path.read_text() == "precious"


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=r"can't listen on .*: No such file"):
        Listening(Place(path=tmp_path / "missing" / "m.sock"))


def test_what_has_taken_our_place_stays(tmp_path: Path) -> None:
    path = tmp_path / "m.sock"
    with Listening(Place(path=path)):
        path.rename(tmp_path / "moved")
        path.write_text("another's")
    assert path.exists()


def test_a_file_that_somebody_removed(tmp_path: Path) -> None:
    with Listening(Place(path=tmp_path / "m.sock")):
        (tmp_path / "m.sock").unlink()
