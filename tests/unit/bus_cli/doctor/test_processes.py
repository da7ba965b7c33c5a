"""bus_cli.doctor.processes: programs that stand still, have another release, or are near a limit."""

import pytest

from bus.base.version import RELEASE
from bus.wire import messages as m
from bus_cli.doctor import procfs
from bus_cli.doctor.daemon import Seen
from bus_cli.doctor.finding import Finding
from bus_cli.doctor.processes import examine
from metrics_views import HELLO, PUBLISHER, endpoint, graph

LIMITS = {
    "connections": 10,
    "connections_per_user": 5,
    "topics": 100,
    "endpoints_per_peer": 4096,
    "queued_bytes_per_user": 1000,
    "lease_s": 10.0,
}


@pytest.fixture(autouse=True)
def states(monkeypatch: pytest.MonkeyPatch) -> dict[int, str]:
    """The state of each process; S unless a test sets another."""
    states: dict[int, str] = {}
    monkeypatch.setattr(procfs, "state", lambda pid: states.get(pid, "S"))
    return states


def peer(**fields: object) -> m.PeerRecord:
    values: dict[str, object] = {"id": 1, "pid": 1001, "uid": 7, "program": "cam.py", "version": RELEASE}
    return m.PeerRecord(**{**values, **fields})  # type: ignore[arg-type]


def look(*peers: m.PeerRecord, users: tuple[m.UserRecord, ...] = ()) -> list[Finding]:
    charges = m.Peers(request=1, peers=peers, users=users, limits=LIMITS)
    return [*examine(Seen(HELLO, graph(endpoint(1, PUBLISHER)), charges))]


def test_all_is_well() -> None:
    text = "1 with nodes; all run, none is near a limit"
    assert look(peer()) == [Finding("ok", "processes", text)]


def test_a_busd_that_does_not_tell(states: dict[int, str]) -> None:
    seen = Seen(HELLO, graph(endpoint(1, PUBLISHER)), None)
    assert [one.mark for one in examine(seen)] == ["ok"]
    states[1001] = "T"
    (found,) = examine(seen)
    assert found.text.startswith("process (pid 1001) (/n1) is stopped")


@pytest.mark.parametrize("state", ["T", "t"])
def test_a_stopped_one(states: dict[int, str], state: str) -> None:
    states[1001] = state
    text = "cam.py (pid 1001) (/n1) is stopped (SIGSTOP, Ctrl-Z or a debugger): it takes no messages"
    advice = "kill -CONT 1001, or fg in its terminal"
    assert look(peer()) == [Finding("warn", "processes", text, advice)]


def test_one_that_has_ended(states: dict[int, str]) -> None:
    states[1001] = "Z"
    (found,) = look(peer())
    assert found.text == "cam.py (pid 1001) (/n1) has ended, but something still holds its connection"


def test_one_that_is_silent() -> None:
    assert look(peer(silent_s=5.9))[0].mark == "ok"
    (found,) = look(peer(silent_s=6.1))
    assert found.text == "cam.py (pid 1001) (/n1) was last heard 6.1 s ago: its event loop stands still"


def test_one_of_another_release() -> None:
    text = f"cam.py (pid 1001) runs release 0.0.9 of the library, the daemon {RELEASE}"
    assert look(peer(version="0.0.9", nodes=1)) == [Finding("warn", "release", text, "start it again")]
    assert "runs release unknown of the library" in look(peer(version="", nodes=1))[0].text
    assert look(peer(version="", nodes=0))[0].mark == "ok"  # a tool that only sends queries


def test_near_a_limit() -> None:
    assert look(peer(endpoints=3276))[0].mark == "ok"
    assert look(peer(endpoints=3277)) == [
        Finding(
            "warn",
            "limits",
            "cam.py (pid 1001) has 3,277 of 4,096 endpoints",
            "raise limits.endpoints_per_peer in busd.toml, or find out why it needs so much",
        )
    ]


def test_a_user_near_a_limit() -> None:
    users = (m.UserRecord(uid=7, connections=5, queued_bytes=900), m.UserRecord(uid=8, connections=4))
    texts = [one.text for one in look(users=users)]
    assert texts == [
        "uid 7 has 5 of 5 processes",
        "uid 7 has 900 of 1,000 queued bytes",
        "the whole bus has 9 of 10 processes",
    ]


@pytest.mark.parametrize(("count", "shown"), [(1, "once"), (1200, "1,200 times")])
def test_who_was_refused_something(count: int, shown: str) -> None:
    (found,) = look(peer(refused=count))
    assert found.text == f"cam.py (pid 1001) reached a limit {shown}, and busd refused its request"
