"""Sockets that listen at an address."""

import socket
import stat
from pathlib import Path

import pytest

from bus_web.listening import ListenError, listening
from bus_web.place import Place


def test_the_kernel_chooses_a_port() -> None:
    with listening(Place("127.0.0.1", 0)) as (listener, place):
        assert place.port == listener.getsockname()[1] > 0
        socket.create_connection((place.address, place.port)).close()
        taken = rf"can't listen on {place}: Address already in use; choose another port with --listen"
        with pytest.raises(ListenError, match=taken), listening(place):
            pass
    with listening(place) as (_, again):
        assert again == place


def test_a_unix_socket_is_for_its_user_and_goes_in_the_end(tmp_path: Path) -> None:
    path = tmp_path / "web.sock"
    place = Place(path=path)
    with listening(place) as (_, told):
        assert told == place
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with pytest.raises(ListenError, match="another process uses it"), listening(place):
            pass
        assert path.exists(), "it is still the first one's"
    assert not path.exists()


def test_one_that_a_killed_process_has_left_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "web.sock"
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(path))
    with listening(Place(path=path)), socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))


def test_what_is_no_socket_stays(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("mine")
    with pytest.raises(ListenError, match="it is not a socket"), listening(Place(path=path)):
        pass
    assert path.read_text() == "mine"
    with pytest.raises(ListenError, match="No such file"), listening(Place(path=tmp_path / "no" / "x")):
        pass
