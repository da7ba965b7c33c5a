"""A peer that breaks the protocol is told why and cut off; the others do not notice. Real busd, raw sockets."""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from neighbours import Neighbours, resident_bytes, wait_until
from raw_peer import HELLO, STRING, RawPeer, control, data, text

from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import (
    CONTROL,
    DATA,
    DATA_HEAD,
    FRAME_HEAD,
    MAX_CONTROL_BYTES,
    MAX_COUNT,
    VERSION,
)
from bus.wire.runs import Run, frame_record
from conftest import Daemon

MiB = 1 << 20


@pytest.fixture
def settings() -> str:
    """What stands in busd.toml; a test's own by `with_limits`."""
    return ""


@pytest.fixture
def daemon(start_daemon: Callable[..., Daemon], tmp_path: Path, settings: str) -> Daemon:
    config = tmp_path / "busd.toml"
    config.write_text(settings)
    return start_daemon("--config", str(config))


@pytest.fixture(autouse=True)
def neighbours(daemon: Daemon) -> Iterator[Neighbours]:
    """They talk all the while, must hear all of it, and busd must not grow because of anybody's rudeness."""
    with Neighbours(daemon.path) as neighbours:
        before = resident_bytes(daemon.pid)
        yield neighbours
        neighbours.carry_on()
        grown = resident_bytes(daemon.pid) - before
        assert grown < 64 * MiB, f"busd has grown by {grown / MiB:.0f} MiB"


@pytest.fixture
def peer(daemon: Daemon) -> Iterator[RawPeer]:
    """One that has connected and said nothing yet."""
    with RawPeer(daemon.path) as peer:
        yield peer


@pytest.fixture
def other(daemon: Daemon) -> Iterator[RawPeer]:
    """One that is polite, for the rude one to be rude to."""
    with RawPeer(daemon.path) as other:
        yield other.hello()


def with_limits(**limits: float) -> Any:
    """Runs the test's daemon with these limits."""
    lines = ["[limits]", *(f"{name} = {value}" for name, value in limits.items())]
    return pytest.mark.parametrize("settings", ["\n".join(lines)], ids=["limits"])


def knows_of(asker: RawPeer, node: str) -> bool:
    graph: m.Graph = asker.ask(m.GetGraph(request=asker.request()))
    return any(one.name == node for one in graph.nodes)


class TestBytes:
    """What is no frame, or no frame yet."""

    @pytest.mark.parametrize(
        ("garbage", "reason"),
        [
            (b"GET / HTTP/1.1\r\nHost: busd\r\n\r\n", "frame of unknown kind 47"),
            (bytes(64), "frame of unknown kind 0"),
            (b"\xff" * 64, "frame of unknown kind 255"),
            (FRAME_HEAD.pack(0, CONTROL, 0, 0), "frame of 0 bytes"),
            (FRAME_HEAD.pack(3, CONTROL, 0, 0), "frame of 3 bytes"),
            (FRAME_HEAD.pack(4, DATA, 0, 0), "frame of 4 bytes"),
            (FRAME_HEAD.pack(0xFFFFFFFF, CONTROL, 0, 0), "frame of 4294967295 bytes"),
            (FRAME_HEAD.pack(0xFFFFFFFF, DATA, 0, 0), "frame of 4294967295 bytes"),
            (FRAME_HEAD.pack(5 + MAX_CONTROL_BYTES, CONTROL, 0, 0), "frame of 1048581 bytes"),
            (FRAME_HEAD.pack(8, CONTROL, 1, 0), "frame with unknown flags 0x1"),
            (FRAME_HEAD.pack(40, DATA, 2, 0), "frame with unknown flags 0x2"),
            (FRAME_HEAD.pack(8, CONTROL, 0, 7), "frame with unknown flags"),
            (data(1, text("x"), count=0), "data frame without samples"),
            (data(1, text("x"), first_seq=MAX_COUNT, count=2), "the last number is"),
            (control(b""), "control message not understood"),
            (control(b"\xc1"), "control message not understood"),
            (control(b"\x81\xa1m\xa4what"), "control message not understood"),
            (control(b"\x82\xa1m\xa5graph\xa7request\x01"), "control message not understood"),
            (control(b"\x82\xa1m\xa4node\xa4\xff\xfe\xfd\xfc\xa1x"), "control message not understood"),
            (control(b"\x91" * 100_000 + b"\xc0"), "control message not understood"),
            (control(b"\xdd\xff\xff\xff\xff"), "control message not understood"),
        ],
        ids=lambda value: value if isinstance(value, str) else "",
    )
    @pytest.mark.parametrize("greeted", [True, False], ids=["after Hello", "before Hello"])
    def test_garbage(self, peer: RawPeer, garbage: bytes, reason: str, greeted: bool) -> None:
        if greeted:
            peer.hello()
        peer.write(garbage)
        assert reason in peer.fault()
