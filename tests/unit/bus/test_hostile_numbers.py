"""Numbers from a broken busd or a broken ring: busd's library refuses them, or limits them to values that it
can send.
"""

from typing import Any

import msgspec
import pytest

from bus.delivery.receiver import Receiver
from bus.delivery.sequence import PublisherProxy
from bus.errors import RemoteProtocolError
from bus.graph import graph_of
from bus.qos import QoSProfile
from bus.shm import is_available
from bus.wire import messages as m
from bus.wire.layout import MAX_COUNT
from rows import for_each

MATCHED = {"endpoint": 1, "other": 2, "node": "/n", "gid": b"", "qos": {}}
ATTACHED = {"publisher": 1, "subscription": 2, "slot": 0, "process": 1, "pid": 1}


@for_each(
    ("tag", "fields"),
    [
        ("hello", {"version": 1, "lease_s": -1.0}),
        ("hello", {"version": 1, "lease_s": float("nan")}),
        ("created", {"request": 1, "id": 1 << 32}),
        ("created", {"request": 1, "id": -1}),
        ("created", {"request": 1, "id": 1, "depth": -1}),
        ("created", {"request": 1, "id": 1, "window_samples": -1}),
        ("matched", MATCHED | {"other": 1 << 32}),
        ("matched", MATCHED | {"next_seq": 0}),
        ("matched", MATCHED | {"next_seq": MAX_COUNT + 2}),
        ("matched", MATCHED | {"at_ns": -1}),
        ("attached", ATTACHED | {"slot": -1}),
        ("attached", ATTACHED | {"pid": 1 << 31}),
        ("rerouted", {"endpoint": 1, "other": -1, "route": "socket"}),
        ("credit", {"publisher": 1, "seq": -1}),
    ],
)
def test_what_no_busd_says_is_refused(tag: str, fields: dict[str, Any]) -> None:
    with pytest.raises(RemoteProtocolError, match="control message not understood"):
        m.from_broker.decode(msgspec.msgpack.encode({"m": tag, **fields}))


def test_the_last_number_of_a_publisher_can_be_told() -> None:
    matched = m.from_broker.decode(
        msgspec.msgpack.encode({"m": "matched", **MATCHED, "next_seq": MAX_COUNT + 1})
    )
    assert matched.next_seq == MAX_COUNT + 1


def test_a_graph_that_contradicts_itself_is_refused() -> None:
    endpoint = m.EndpointRecord(
        id=2, kind="publisher", node=7, topic="/a", type_name="x", type_hash="y", gid=b"", qos=QoSProfile()
    )
    snapshot = m.GraphSnapshot(request=1, revision=1, nodes=(), endpoints=(endpoint,), matches=())
    with pytest.raises(RemoteProtocolError, match="node 7, which is not in it"):
        graph_of(snapshot)


@pytest.mark.skipif(not is_available(), reason="the native core is not there")
def test_a_stamp_beyond_all_time_is_brought_into_the_queue() -> None:
    from shm_ends import Listener, Talker

    talker, listener = Talker(), Listener()
    listener.join(talker, PublisherProxy(1, b"", 0, 0, needs_ack=False))
    receiver: Receiver[bytes] = Receiver(
        bytes, 0, is_lossless=False, on_drop=print, on_reject=print, on_taken=lambda source: None
    )
    receiver.reader = listener.reader
    assert talker.writer.write_parts([b"late"], stamp_ns=(1 << 64) - 1) is True
    receiver.drain_rings()
    assert [taken[0] for taken in (receiver.take(), receiver.take()) if taken is not None] == [b"late"]
    talker.close()
    listener.close()
