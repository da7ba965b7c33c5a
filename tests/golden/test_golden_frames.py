"""The bytes of every kind of frame, as they were when their protocol version came out.

Once a version is out, its files must never change: a wire that needs it is another version. A new file gets
the hex that the failing test prints.
"""

from pathlib import Path
from typing import Any

import msgspec

from bus.qos import QoSProfile
from bus.wire import messages as m
from bus.wire.layout import FRAME_HEAD_BYTES, PROTOCOL_VERSION
from bus.wire.runs import Account, Run, RunQueue
from bus.wire.session import Role, Session
from feeding import feed, frame_record
from rows import for_each

FOLDER = Path(__file__).parent / f"v{PROTOCOL_VERSION}"
GID = bytes(range(16))
EVERY_POLICY = QoSProfile(
    depth=7,
    history="keep_all",
    reliability="best_effort",
    durability="transient_local",
    deadline=0.5,
    lifespan=2.0,
    liveliness="manual_by_topic",
    liveliness_lease_duration=1.5,
)
NODE = m.NodeRecord(id=1, name="talker", namespace="/robot", pid=4711)
ENDPOINT = m.EndpointRecord(
    id=2,
    kind="publisher",
    node=1,
    topic="/topic",
    type_name="std_msgs/msg/String",
    type_hash="RIHS01_df66",
    gid=GID,
    qos=QoSProfile(),
    statistics=m.EndpointStatistics(samples=3, bytes=99, queued=1, dropped={"replaced": 2}),
)
HEARING = m.EndpointRecord(
    id=3,
    kind="subscription",
    node=1,
    topic="/topic",
    type_name="std_msgs/msg/String",
    type_hash="RIHS01_df66",
    gid=GID,
    qos=QoSProfile(),
    statistics=m.EndpointStatistics(samples=3, bytes=99, queued=1, dropped={"replaced": 2}, expected=6),
)
COUNTED = msgspec.structs.replace(
    ENDPOINT, statistics=m.EndpointStatistics(samples=3, bytes=99, at_ns=1_000_000_007)
)
AGED = msgspec.structs.replace(
    HEARING,
    statistics=m.EndpointStatistics(
        samples=3, bytes=99, at_ns=1_000_000_007, age_count=2, age_sum_ns=90_000, age_max_ns=50_000
    ),
)
MATCH = m.MatchRecord(publisher=2, subscription=3)

FROM_CLIENT: dict[str, m.Message] = {
    "hello": m.Hello(version=1, capabilities=("shm",), pid=4711, program="talker.py"),
    "hello_release": m.Hello(
        version=1, capabilities=("leaving",), pid=4711, program="talker.py", release="0.1.0"
    ),
    "ping": m.Ping(number=5),
    "pong": m.Pong(number=5),
    "declare_type": m.DeclareType(
        type_name="std_msgs/msg/String", type_hash="RIHS01_df66", schema=(b"\x81\xa4data\xa3str")
    ),
    "share": m.Share(),
    "create_node": m.CreateNode(request=1, name="talker", namespace="/robot"),
    "create_node_origin": m.CreateNode(
        request=1,
        name="talker",
        namespace="/robot",
        origin=m.Origin(bridge="zenoh", bus="hub", via=("robot-1",)),
    ),
    "destroy_node": m.DestroyNode(node=1),
    "create_publisher_mirror": m.CreatePublisher(
        request=2,
        node=1,
        topic="/topic",
        type_name="std_msgs/msg/String",
        type_hash="RIHS01_df66",
        qos=QoSProfile(),
        gid=GID,
        stands_for=bytes(16),
    ),
    "create_subscription_tap": m.CreateSubscription(
        request=3,
        node=1,
        topic="/topic",
        type_name="std_msgs/msg/String",
        type_hash="RIHS01_df66",
        qos=QoSProfile(),
        gid=GID,
        local_only=True,
        role="tap",
    ),
    "create_publisher": m.CreatePublisher(
        request=2,
        node=1,
        topic="/topic",
        type_name="std_msgs/msg/String",
        type_hash="RIHS01_df66",
        qos=EVERY_POLICY,
        gid=GID,
        next_seq=8,
    ),
    "create_publisher_ring": m.CreatePublisher(
        request=2,
        node=1,
        topic="/topic",
        type_name="std_msgs/msg/String",
        type_hash="RIHS01_df66",
        qos=QoSProfile(),
        gid=GID,
        descriptors=1,
    ),
    "create_subscription": m.CreateSubscription(
        request=3,
        node=1,
        topic="/topic",
        type_name="std_msgs/msg/String",
        type_hash="RIHS01_df66",
        qos=QoSProfile(),
        gid=GID,
        last_seqs={GID: 41},
    ),
    "destroy_endpoint": m.DestroyEndpoint(endpoint=2),
    "assert_liveliness": m.AssertLiveliness(publisher=2),
    "ack": m.Ack(subscription=3, source=2, seq=1 << 40),
    "attach": m.Attach(subscription=3, source=2, slot=1019),
    "refuse_route": m.RefuseRoute(endpoint=3, other=2, text="the ring is no memfd"),
    "leave_ring": m.LeaveRing(subscription=3, source=2, seq=1 << 33),
    "caught_up": m.CaughtUp(publisher=2, subscription=3),
    "replace_ring": m.ReplaceRing(publisher=2),
    "report": m.Report(endpoint=3, samples=10, bytes=400, queued=2, dropped={"undecodable": 1}),
    "report_expected": m.Report(
        endpoint=3, samples=10, bytes=400, queued=2, dropped={"undecodable": 1}, expected=13, repeated=2
    ),
    "report_at": m.Report(endpoint=3, samples=10, bytes=400, at_ns=1_000_000_007),
    "report_ages": m.Report(
        endpoint=3,
        samples=10,
        bytes=400,
        at_ns=1_000_000_007,
        age_count=4,
        age_sum_ns=90_000,
        age_max_ns=50_000,
    ),
    "report_missed": m.Report(endpoint=3, samples=10, bytes=400, dropped={"replaced": 22}, most_missed=22),
    "report_age_parts": m.Report(
        endpoint=3,
        samples=10,
        bytes=400,
        age_count=4,
        age_sum_ns=9000,
        age_max_ns=3000,
        age_parts=(0, 1, 2, 1),
    ),
    "get_graph": m.GetGraph(request=4, statistics=True),
    "get_type": m.GetType(request=5, type_name="std_msgs/msg/String", type_hash="RIHS01_df66"),
    "observe": m.Observe(request=6),
    "observe_off": m.Observe(request=7, on=False),
    "get_peers": m.GetPeers(request=9),
    "stop_broker": m.StopBroker(request=8),
    "reload": m.Reload(request=9),
    "stop_broker_restart": m.StopBroker(request=8, restart=True),
}
FROM_BROKER: dict[str, m.Message] = {
    "hello_began": m.Hello(
        version=1, pid=4711, program="busd", lease_s=10.0, release="0.1.0", began_ns=1_000_000_007
    ),
    "created": m.Created(
        request=2, id=2, depth=10, max_message_bytes=1 << 26, window_samples=65536, window_bytes=1 << 22
    ),
    "done": m.Done(request=7),
    "done_text": m.Done(request=9, text="limits.depth: 100 -> 50"),
    "refused": m.Refused(request=2, text="topics: 2 of 2 in use", resource="topics", used=2, limit=2),
    "refused_denied": m.Refused(request=2, text="user 1001 may not publish on '/topic'", denied=True),
    "fault": m.Fault(text="a Ping came before Hello"),
    "leaving": m.Leaving(text="SIGTERM"),
    "matched": m.Matched(endpoint=3, other=2, node="/robot/talker", gid=GID, qos=EVERY_POLICY, next_seq=42),
    "matched_unproven": m.Matched(
        endpoint=3,
        other=2,
        node="/robot/talker",
        gid=GID,
        qos=QoSProfile(),
        awaits_sign=True,
    ),
    "matched_mirror": m.Matched(
        endpoint=3,
        other=2,
        node="/robot/talker",
        gid=GID,
        qos=QoSProfile(),
        route="bridge",
        stands_for=bytes(16),
        is_tap=True,
    ),
    "matched_shm": m.Matched(
        endpoint=3,
        other=2,
        node="/robot/talker",
        gid=GID,
        qos=QoSProfile(),
        route="shm",
        next_seq=42,
        at_ns=1_000_000_007,
        descriptors=2,
    ),
    "unmatched": m.Unmatched(endpoint=3, other=2),
    "unmatched_publisher": m.Unmatched(endpoint=3, other=2, last_seq=1 << 33),
    "unmatched_subscription": m.Unmatched(endpoint=2, other=3, lost=True),
    "attached": m.Attached(publisher=2, subscription=3, slot=1019, process=4, pid=4711),
    "ring_replaced": m.RingReplaced(subscription=3, source=2),
    "rerouted": m.Rerouted(endpoint=3, other=2, route="socket", at_ns=1_000_000_007),
    "rerouted_publisher": m.Rerouted(endpoint=2, other=3, route="socket", at_ns=1_000_000_007, last_seq=5),
    "namesake": m.Namesake(node=1, pid=4711, program="talker.py"),
    "incompatible_type": m.Incompatible(
        endpoint=3,
        topic="/topic",
        node="/robot/talker",
        policy="TYPE",
        text="their definitions differ",
        type_hash="RIHS01_df66",
    ),
    "incompatible": m.Incompatible(
        endpoint=3,
        topic="/topic",
        node="/robot/talker",
        policy="RELIABILITY",
        text="ERROR: Best effort publisher and reliable subscription;",
    ),
    "liveliness_changed": m.LivelinessChanged(subscription=3, publisher=2, alive=False),
    "liveliness_lost": m.LivelinessLost(publisher=2),
    "silence": m.Silence(publisher=2, subscription=3, silent_s=10.25),
    "silence_over": m.Silence(publisher=2, subscription=3, silent_s=13.5, is_over=True),
    "dropped": m.Dropped(subscription=3, dropped={"replaced": 5, "expired": 1}),
    "credit": m.Credit(publisher=2, seq=300),
    "graph": m.GraphSnapshot(
        request=4, revision=9, nodes=(NODE,), endpoints=(ENDPOINT,), matches=(MATCH,), pid=1
    ),
    "graph_expected": m.GraphSnapshot(request=4, revision=9, nodes=(), endpoints=(HEARING,), matches=()),
    "graph_at": m.GraphSnapshot(request=4, revision=9, nodes=(), endpoints=(COUNTED,), matches=()),
    "graph_ages": m.GraphSnapshot(request=4, revision=9, nodes=(), endpoints=(AGED,), matches=()),
    "graph_changed": m.GraphChanged(
        revision=10,
        nodes_added=(NODE,),
        nodes_removed=(4,),
        endpoints_removed=(5,),
        matches_removed=(MATCH,),
    ),
    "peers": m.Peers(
        request=9,
        peers=(
            m.PeerRecord(
                id=1,
                pid=4711,
                uid=1000,
                program="talker.py",
                version="0.1.0",
                nodes=1,
                endpoints=2,
                topics=2,
                matches=1,
                descriptors=4,
                queued_bytes=300,
                history_bytes=400,
                control_bytes=50,
                refused=6,
                silent_s=0.5,
            ),
        ),
        users=(
            m.UserRecord(
                uid=1000,
                connections=1,
                endpoints=2,
                topics=2,
                descriptors=4,
                queued_bytes=300,
                history_bytes=400,
                refused=6,
            ),
        ),
        routing=m.RoutingRecord(
            runs=7, samples=70, bytes=7000, bounds_us=(16, 64), counts=(4, 2, 1), total_us=300
        ),
        limits={"connections": 256, "lease_s": 10.0},
    ),
    "type_description": m.TypeDescription(request=5, schema=(b"\x81\xa4data\xa3str")),
}
CONTROL = {**FROM_CLIENT, **FROM_BROKER}

FROM_EARLIER_BROKERS: dict[str, m.Message] = {
    "matched_foreign": m.Matched(
        endpoint=3, other=2, node="/robot/talker", gid=GID, qos=QoSProfile(), route="shm", descriptors=2
    ),
    "attached_foreign": m.Attached(publisher=2, subscription=3, slot=7, process=4, pid=4711),
}
"""With fields that nobody sends any more: what is understood of them."""


def run(*, is_replay: bool = False, is_resumed: bool = False) -> Run:
    body = frame_record(b"\xa5hello", 1_000_000_007) + frame_record(b"", -1)
    return Run(0, 2, 1 << 33, 2, body, is_replay, is_resumed=is_resumed)


DATA: dict[str, Run] = {
    "run": run(),
    "run_replay": run(is_replay=True),
    "run_resumed": run(is_resumed=True),
}


def frame(what: m.Message | Run) -> bytes:
    if isinstance(what, m.Message):
        return m.encode_frame(what)
    queue = RunQueue(0, Account(1 << 20), endpoint=3)
    queue.append(what)
    return b"".join(queue.pop_frame())


def golden(name: str) -> bytes:
    return bytes.fromhex((FOLDER / f"{name}.hex").read_text())


@for_each("name", [*CONTROL, *DATA])
def test_what_is_sent(name: str) -> None:
    made = frame(CONTROL.get(name) or DATA[name])
    shown = "\n".join(made[at : at + 32].hex(" ") for at in range(0, len(made), 32))
    assert (FOLDER / f"{name}.hex").exists(), shown
    assert made == golden(name), shown


@for_each(("name", "message"), [*CONTROL.items(), *FROM_EARLIER_BROKERS.items()])
def test_what_is_understood(name: str, message: m.Message) -> None:
    decoder = m.from_client if name in FROM_CLIENT else m.from_broker
    decoded = decoder.decode(golden(name)[FRAME_HEAD_BYTES:])
    assert type(decoded) is type(message)
    assert m.encode_frame(decoded) == m.encode_frame(message)


@for_each(("name", "expected"), DATA.items())
def test_which_run_is_understood(name: str, expected: Run) -> None:
    session = Session(Role.CLIENT)
    found: list[Any] = list(feed(session, golden("hello") + golden(name)))
    made = found[1]
    assert (made.endpoint, made.source, made.first_seq, made.count, made.is_replay, made.is_resumed) == (
        3, 2, 1 << 33, 2, expected.is_replay, expected.is_resumed,
    )  # fmt: skip
    assert [(bytes(payload), stamp_ns) for payload, stamp_ns in made.records()] == [
        (b"\xa5hello", 1_000_000_007),
        (b"", -1),
    ]


def test_every_message_has_a_frame() -> None:
    assert {type(message) for message in CONTROL.values()} == set(m.Message.__subclasses__())


def test_every_file_is_used() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == {*CONTROL, *DATA, *FROM_EARLIER_BROKERS}
