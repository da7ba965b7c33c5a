"""bus.link.reach: tries to connect, and for how long."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from bus.errors import BrokerUnavailable
from bus.link.reach import NotNow, Patience, try_to_connect


class TestPatience:
    def test_pauses_grow_and_end_with_the_time(self) -> None:
        now_s = 100.0
        patience, pauses = Patience(0.5, lambda: now_s), []
        with pytest.raises(BrokerUnavailable) as caught:
            while True:
                pauses.append(patience.pause_s("the door is shut"))
                now_s += pauses[-1]
        assert str(caught.value) == "the door is shut; tried for 0.5 s"
        assert not isinstance(caught.value, NotNow)
        assert pauses[:7] == [0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.05]
        assert max(pauses) == 0.05
        assert Patience(0.5, lambda: now_s).pause_s("", 0.0005) == 0.0005
        assert sum(pauses) == pytest.approx(0.5)

    def test_who_gets_further_begins_anew(self) -> None:
        now_s = 0.0
        patience = Patience(1.0, lambda: now_s)
        for _ in range(3):
            now_s += 0.9
            patience.pause_s("")
            patience.renew()
        assert patience.pause_s("") == 0.001
        now_s += 1.0
        with pytest.raises(BrokerUnavailable):
            patience.pause_s("")


class TestTry:
    @pytest.fixture
    def path(self, tmp_path: Path) -> Path:
        return tmp_path / "busd.sock"

    @pytest.fixture
    def listening(self, path: Path) -> Iterator[socket.socket]:
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(path))
            listening.listen(0)
            yield listening

    def test_it_is_connected_and_does_not_block(self, path: Path, listening: socket.socket) -> None:
        with try_to_connect(path) as sock, listening.accept()[0] as other:
            other.send(b"x")
            assert not sock.getblocking()
            assert sock.recv(1) == b"x"

    def test_a_full_backlog_passes(self, path: Path, listening: socket.socket) -> None:
        """asyncio's sock_connect() treats a socket as connected in this case although it is not."""
        with ExitStack() as stack:
            stack.enter_context(try_to_connect(path))
            with pytest.raises(NotNow, match=f"busd at {path} takes no connection: too many wait"):
                for _ in range(10):
                    stack.enter_context(try_to_connect(path))

    def test_nobody_is_there(self, path: Path) -> None:
        with pytest.raises(FileNotFoundError):
            try_to_connect(path)
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(path))
        with pytest.raises(ConnectionRefusedError):
            try_to_connect(path)

    def test_what_can_not_be_used(self, tmp_path: Path) -> None:
        for path in (tmp_path / ("x" * 200), tmp_path / "file" / "below"):
            (tmp_path / "file").touch()
            with pytest.raises(BrokerUnavailable, match=f"cannot connect to busd at {path}: "):
                try_to_connect(path)
