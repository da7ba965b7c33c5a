"""docs/assets/frames.json has every golden frame, and busd understands each as the file says."""

import json
from typing import Any

import msgspec

import framesfile
from bus.wire import messages as m
from bus.wire.layout import FRAME_HEAD_BYTES
from bus.wire.session import Role, Session
from feeding import feed
from rows import for_each

FRAMES: dict[str, dict[str, Any]] = {one["name"]: one for one in json.loads(framesfile.FILE.read_text())}
CONTROL = {name: one for name, one in FRAMES.items() if one["kind"] == "control"}
DATA = {name: one for name, one in FRAMES.items() if one["kind"] == "data"}


def test_the_file_is_made_of_the_golden_frames() -> None:
    assert framesfile.FILE.read_text() == framesfile.text(), "run: make api"


def test_it_has_every_message() -> None:
    assert {one["message"] for one in CONTROL.values()} == {
        cls.__name__ for cls in m.Message.__subclasses__()
    }


@for_each(("name", "one"), CONTROL.items())
def test_busd_understands_a_message_as_the_file_says(name: str, one: dict[str, Any]) -> None:
    decoder = m.from_broker if one["sender"] == "busd" else m.from_client
    message = decoder.decode(bytes.fromhex(one["hex"])[FRAME_HEAD_BYTES:])
    assert type(message).__name__ == one["message"]
    values = {field: getattr(message, field) for field in message.__struct_fields__}
    said = one["fields"] | one["absent"]
    assert said.keys() == values.keys()
    complete: Any = msgspec.msgpack.decode(msgspec.msgpack.encode(values))
    assert {field: framesfile.plain(value) for field, value in complete.items()} == said


@for_each(("name", "one"), DATA.items())
def test_a_client_understands_a_run_as_the_file_says(name: str, one: dict[str, Any]) -> None:
    hello = bytes.fromhex(FRAMES["hello"]["hex"])
    run = next(iter(list(feed(Session(Role.CLIENT), hello + bytes.fromhex(one["hex"])))[1:]))
    assert (run.endpoint, run.source, run.is_replay, run.is_resumed) == (
        one["endpoint"], one["source"], one["is_replay"], one["is_resumed"],
    )  # fmt: skip
    records = [(bytes(payload).hex(), stamp_ns) for payload, stamp_ns in run.records()]
    assert records == [(sample["payload"], sample["stamp_ns"]) for sample in one["samples"]]
    assert [sample["seq"] for sample in one["samples"]] == list(
        range(run.first_seq, run.first_seq + run.count)
    )
