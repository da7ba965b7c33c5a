"""`make api`: docs/assets/frames.json, the golden frames with their meaning, for tests of other clients.

Made of `tests/golden/v1/` with a general MessagePack decoder. The message classes only give the names of
messages and the defaults of absent fields.
"""

import json
from pathlib import Path
from typing import Any, get_args

import msgspec

from bus.wire import messages as m
from bus.wire.layout import (
    CONTROL,
    DATA_HEAD,
    DATA_HEAD_BYTES,
    FRAME_HEAD,
    FRAME_HEAD_BYTES,
    PROTOCOL_VERSION,
    RECORD_HEAD,
    RECORD_HEAD_BYTES,
    REPLAY,
    RESUMED,
)

GOLDEN = Path(__file__).parent / "golden" / f"v{PROTOCOL_VERSION}"
FILE = Path(__file__).parents[1] / "docs" / "assets" / "frames.json"

FROM_CLIENT, FROM_BROKER = get_args(m.FromClient), get_args(m.FromBroker)
BY_TAG = {cls.__struct_config__.tag: cls for cls in (*FROM_CLIENT, *FROM_BROKER)}


def text() -> str:
    """The file: a list with one frame on each line."""
    frames = [described(path.stem, bytes.fromhex(path.read_text())) for path in sorted(GOLDEN.iterdir())]
    return "[\n" + ",\n".join(json.dumps(frame) for frame in frames) + "\n]\n"


def described(name: str, raw: bytes) -> dict[str, Any]:
    """One frame with its meaning."""
    _, kind, flags, _ = FRAME_HEAD.unpack_from(raw)
    meaning = _control(raw[FRAME_HEAD_BYTES:]) if kind == CONTROL else _data(raw, flags)
    return {"name": name, **meaning, "hex": raw.hex()}


def _control(body: bytes) -> dict[str, Any]:
    fields: dict[str, Any] = msgspec.msgpack.decode(body)
    cls = BY_TAG[fields["m"]]
    known = {field.encode_name: field for field in msgspec.structs.fields(cls)}
    sender = "client" if cls in FROM_CLIENT else "busd"
    return {
        "kind": "control",
        "sender": "both" if cls in FROM_CLIENT and cls in FROM_BROKER else sender,
        "message": cls.__name__,
        "fields": {name: plain(value) for name, value in fields.items() if name in known},
        "absent": {name: plain(_default(field)) for name, field in known.items() if name not in fields},
        "unknown": sorted(fields.keys() - known.keys() - {"m"}),
    }


def _default(field: msgspec.structs.FieldInfo) -> Any:
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    return msgspec.msgpack.decode(msgspec.msgpack.encode(value))


def _data(raw: bytes, flags: int) -> dict[str, Any]:
    *_, endpoint, source, first_seq, count, _ = DATA_HEAD.unpack_from(raw)
    samples, at = [], DATA_HEAD_BYTES
    for seq in range(first_seq, first_seq + count):
        size, stamp_ns = RECORD_HEAD.unpack_from(raw, at)
        at += RECORD_HEAD_BYTES
        samples.append({"seq": seq, "stamp_ns": stamp_ns, "payload": raw[at : at + size].hex()})
        at += size
    return {
        "kind": "data",
        "sender": "busd",
        "endpoint": endpoint,
        "source": source,
        "is_replay": bool(flags & REPLAY),
        "is_resumed": bool(flags & RESUMED),
        "samples": samples,
    }


def plain(value: Any) -> Any:
    """The value for JSON: bytes are `{"bin": HEX}`, maps with other keys than texts are `{"map": PAIRS}`."""
    match value:
        case bytes():
            return {"bin": value.hex()}
        case list() | tuple():
            return [plain(one) for one in value]
        case dict() if all(isinstance(key, str) for key in value):
            return {key: plain(one) for key, one in value.items()}
        case dict():
            return {"map": [[plain(key), plain(one)] for key, one in value.items()]}
    return value


if __name__ == "__main__":
    FILE.write_text(text())
    print(f"written: {FILE}")
