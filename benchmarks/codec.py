"""The cost of CDR: a payload to CDR and back, beside msgspec's JSON, and rosbags with its own messages."""

from collections.abc import Callable
from typing import Any

import msgspec

import bus
from benchmarks.adapters.publish_costs import messages, per_call_ns
from benchmarks.cases import Outcome
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare
from bus.msg.geometry_msgs import Quaternion, Transform, TransformStamped, Vector3
from bus.msg.sensor_msgs import JointState
from bus.msg.std_msgs import Header
from bus.types.classes import message_class
from bus_ros.cdr import Codec, codec_of

NAME = "codec"
_COLUMNS = [
    Column("encode_us", "us: to CDR", "lower"),
    Column("to_json_us", "to JSON"),
    Column("serialize_us", "rosbags"),
    Column("decode_us", "from CDR", "lower"),
    Column("from_json_us", "from JSON"),
    Column("deserialize_us", "rosbags"),
]
_NOTES = [
    "each but those of rosbags: from a MessagePack payload, or to one; JSON by way of the message's class",
    "rosbags: of a message that it has made, or to one; it knows no payloads",
]
_GOALS = {("Imu", "to_json_us"): 1.2, ("tf of 4", "serialize_us"): 0.5}


def run(plan: Plan) -> Section:
    """Measure each message; the calls of one message take turns."""
    outcomes: list[Outcome] = []
    comparisons = []
    for name, message in _messages().items():
        outcome = Outcome(name, series=name)
        calls = _calls(message)
        for number in range(plan.repetitions):
            plan.tell(f"codec {number + 1} of {plan.repetitions}: {name}")
            part_s = plan.choose(20, 100) / 1000
            figures = {key: per_call_ns(call, given, part_s) / 1000 for key, (call, given) in calls.items()}
            outcome.repetitions.append(figures)
        outcomes.append(outcome)
        for key, what in (("to_json_us", "JSON"), ("serialize_us", "rosbags")):
            ratios = [one["encode_us"] / one[key] for one in outcome.repetitions if key in one]
            comparisons += compare(f"{name}: to CDR over {what}", ratios, at_most=_GOALS.get((name, key)))
    rows = [Row.of(outcome) for outcome in outcomes]
    notes = _NOTES if _rosbags() else [*_NOTES, "rosbags is not installed: pip install rosbags"]
    return Section(NAME, "CDR: what bags and bridges add to a message", _COLUMNS, rows, comparisons, notes)


def _messages() -> dict[str, msgspec.Struct]:
    transforms = [
        TransformStamped(
            header=Header(frame_id="odom"),
            child_frame_id=f"link_{index}",
            transform=Transform(translation=Vector3(x=0.1, y=0.2), rotation=Quaternion(x=0.6, w=0.8)),
        )
        for index in range(4)
    ]
    values = [0.1 * index for index in range(7)]
    joints = [f"joint_{index}" for index in range(7)]
    tf: Any = message_class("tf2_msgs/msg/TFMessage")
    known = messages()
    return {
        **{name: known[name] for name in ("String of 64 B", "Imu")},
        "tf of 4": tf(transforms=transforms),
        "JointState of 7": JointState(name=joints, position=values, velocity=values, effort=values),
        "Image of 1 MiB": known["Image of 1 MiB"],
    }


def _calls(message: msgspec.Struct) -> dict[str, tuple[Callable[[Any], object], Any]]:
    """The calls to measure, each with its argument."""
    cls = type(message)
    codec = codec_of(bus.MessageSchema.of(cls))
    pack, to_json = msgspec.msgpack.Encoder().encode, msgspec.json.Encoder().encode
    unpack, from_json = msgspec.msgpack.Decoder(cls).decode, msgspec.json.Decoder(cls).decode
    payload = pack(message)
    cdr = b"".join(codec.encode(payload))
    calls: dict[str, tuple[Callable[[Any], object], Any]] = {
        "encode_us": (codec.encode, payload),
        "to_json_us": (lambda payload: to_json(unpack(payload)), payload),
        "decode_us": (codec.decode, cdr),
        "from_json_us": (lambda text: pack(from_json(text)), to_json(message)),
    }
    if (typesys := _rosbags()) is not None:
        store = _store(typesys, codec)
        calls["serialize_us"] = (
            lambda message: store.serialize_cdr(message, codec.type_name),
            store.deserialize_cdr(cdr, codec.type_name),
        )
        calls["deserialize_us"] = (lambda data: store.deserialize_cdr(data, codec.type_name), cdr)
    return calls


def _rosbags() -> Any:
    try:
        from rosbags import typesys
    except ImportError:
        return None
    return typesys


def _store(typesys: Any, codec: Codec) -> Any:
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(codec.definition, codec.type_name))
    return store
