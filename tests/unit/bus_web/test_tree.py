"""Messages as trees: folded parts, values that JSON does not have, and bounds."""

import math
from array import array
from typing import Any

import msgspec

from bus.msg.geometry_msgs import Point, PoseWithCovariance
from bus.msg.sensor_msgs import Image
from bus.msg.std_msgs import ByteMultiArray
from bus_web.tree import tree_of
from rows import for_each


class Holder(msgspec.Struct):
    value: Any = None


class Deep(msgspec.Struct):
    below: "Deep | None" = None


def test_structs_and_short_arrays() -> None:
    tree = tree_of(PoseWithCovariance())
    assert tree["pose"]["position"] == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert tree["covariance"] == {"$array": 36, "head": [0.0] * 8}


def test_arrays_that_were_opened() -> None:
    covariance = [float(number) for number in range(36)]
    tree = tree_of(Holder(PoseWithCovariance(covariance=covariance)), ["value.covariance"])
    assert tree["value"]["covariance"] == {"$array": 36, "head": covariance}
    many = tree_of(Holder([1] * 5000), ["value"])["value"]
    assert (many["$array"], len(many["head"])) == (5000, 1000)


@for_each(
    ("value", "shown"),
    [
        (None, None),
        (True, True),
        (-3, -3),
        (1 << 60, {"$number": str(1 << 60)}),
        (1.5, 1.5),
        (math.nan, {"$number": "nan"}),
        (-math.inf, {"$number": "-inf"}),
        ("<b>&amp;", "<b>&amp;"),
        ("x" * 5000, {"$text": 5000, "head": "x" * 1000}),
        (b"\x00\xff", {"$bytes": 2, "head": "00ff"}),
        (bytearray(100), {"$bytes": 100, "head": "00" * 32}),
        (memoryview(bytes(100)), {"$bytes": 100, "head": "00" * 32}),
        ([1, [2]], [1, [2]]),
        ((1, 2), [1, 2]),
        ({"a": 1, "b": [2]}, {"$map": [["a", 1], ["b", [2]]], "length": 2}),
        ([Point(x=1.0)], [{"x": 1.0, "y": 0.0, "z": 0.0}]),
        (array("d", [0.5, 1.0]), [0.5, 1.0]),
    ],
)
def test_values(value: object, shown: object) -> None:
    tree = tree_of(Holder(value))["value"]
    assert tree == shown
    msgspec.json.encode(tree)


def test_octets_are_as_they_travel() -> None:
    assert tree_of(ByteMultiArray(data=b"\x01\x02"))["data"] == {"$bytes": 2, "head": "0102"}


def test_too_deep_and_too_much() -> None:
    deep = Deep()
    for _ in range(100):
        deep = Deep(deep)
    assert "$folded" in msgspec.json.encode(tree_of(deep)).decode()
    wide = [[[[[0] * 8] * 8] * 8] * 8] * 8
    assert len(msgspec.json.encode(tree_of(Holder(wide)))) < 500_000


def test_many_long_texts_and_many_pictures_are_too_much() -> None:
    texts = tree_of(
        Holder([["\u20ac" * 1000] * 20] * 1000), ["value", *(f"value.{at}" for at in range(1000))]
    )
    assert len(msgspec.json.encode(texts)) < 8 << 20
    picture = Image(width=240, height=240, step=720, encoding="rgb8", data=bytes(240 * 720))
    told = msgspec.json.encode(tree_of(Holder([picture] * 100), ["value"]))
    assert 8 <= told.count(b"$image") < 16
    assert len(told) < 4 << 20


def test_images_have_a_picture_in_place_of_their_data() -> None:
    image = Image(width=2, height=1, step=6, encoding="rgb8", data=bytes(range(6)))
    told = msgspec.json.decode(msgspec.json.encode(tree_of(image)))
    assert told["data"] == {"$image": {"width": 2, "height": 1, "of": [2, 1], "rgb": "AAECAwQF"}}
