"""Reduced images: the order of colours, rows with padding, and images that can't be drawn."""

import struct
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from msgspec import defstruct

from bus.msg.sensor_msgs import CompressedImage, Image
from bus_web import pictures
from rows import for_each


def picture_of(message: Any) -> Any:
    return pictures.picture_of(message)


ANY_IMAGE = defstruct("AnyImage", ["width", "height", "step", "is_bigendian", "format", "encoding", "data"])


def png(width: int, height: int) -> bytes:
    """The head of a PNG file."""
    return b"\x89PNG\r\n\x1a\n" + struct.pack("!I4sII", 13, b"IHDR", width, height)


def jpeg(width: int, height: int) -> bytes:
    """The head of a JPEG file, with an application segment before it, and a fill byte."""
    frame = struct.pack("!BHBHHB", 0xC0, 17, 8, height, width, 3)
    return b"\xff\xd8\xff\xe0\x00\x04ab\xff\xff" + frame


PIXELS = {  # one red pixel, and one of (1, 2, 3)
    "rgb8": bytes([255, 0, 0, 1, 2, 3]),
    "bgr8": bytes([0, 0, 255, 3, 2, 1]),
    "rgba8": bytes([255, 0, 0, 9, 1, 2, 3, 9]),
    "bgra8": bytes([0, 0, 255, 9, 3, 2, 1, 9]),
}


@for_each(("encoding", "data"), PIXELS.items())
def test_colours(encoding: str, data: bytes) -> None:
    image = Image(width=2, height=1, step=len(data), encoding=encoding, data=data)
    assert picture_of(image)["rgb"] == bytes([255, 0, 0, 1, 2, 3])


@for_each(
    ("encoding", "is_bigendian", "data"),
    [("mono8", 0, bytes([7, 8])), ("mono16", 0, bytes([0, 7, 0, 8])), ("16UC1", 1, bytes([7, 0, 8, 0]))],
)
def test_grey(encoding: str, is_bigendian: int, data: bytes) -> None:
    image = Image(width=2, height=1, step=len(data), encoding=encoding, is_bigendian=is_bigendian, data=data)
    assert picture_of(image)["rgb"] == bytes([7, 7, 7, 8, 8, 8])


def test_rows_may_be_padded() -> None:
    image = Image(width=1, height=2, step=5, encoding="rgb8", data=bytes([1, 2, 3, 0, 0, 4, 5, 6, 0, 0]))
    assert picture_of(image)["rgb"] == bytes([1, 2, 3, 4, 5, 6])


def test_large_ones_become_small() -> None:
    image = Image(width=640, height=480, step=1920, encoding="rgb8", data=bytes(640 * 480 * 3))
    picture = picture_of(image)
    assert (picture["width"], picture["height"], picture["of"]) == (214, 160, [640, 480])
    assert len(picture["rgb"]) == 214 * 160 * 3


@for_each(
    "image",
    [
        Image(),
        Image(width=2, height=1, step=6, encoding="rgb8", data=bytes(5)),
        Image(width=3, height=1, step=6, encoding="rgb8", data=bytes(6)),
        Image(width=2, height=1, step=6, encoding="yuv422", data=bytes(6)),
        Image(width=1, height=1, step=0, encoding="rgb8", data=bytes(9)),
        CompressedImage(format="jpeg", data=b"<svg>"),
        CompressedImage(format="png", data=b"\x89PNG\r\n" + bytes(1 << 20)),
        CompressedImage(format="png", data=png(20_000, 20_000)),
        CompressedImage(format="png", data=png(0, 5)),
        CompressedImage(format="png", data=png(5, 5)[:20]),
        CompressedImage(format="jpeg", data=jpeg(60_000, 60_000)),
        CompressedImage(format="jpeg", data=jpeg(5, 5)[:-2]),
        CompressedImage(format="jpeg", data=b"\xff\xd8" + b"\xff" * 100_000),
        CompressedImage(format="jpeg", data=b"\xff\xd8\xff\xe0" + bytes(100_000)),
    ],
)
def test_what_can_not_be_drawn(image: Image | CompressedImage) -> None:
    assert picture_of(image) is None


def test_compressed_ones_go_as_they_are() -> None:
    for kind, data in (("jpeg", jpeg(4000, 3000)), ("png", png(4000, 3000))):
        picture = picture_of(CompressedImage(format="whatever", data=data))
        assert (picture["type"], picture["data"]) == (f"image/{kind}", data)


@given(
    st.lists(
        st.one_of(
            st.integers(-3, 9), st.floats(), st.booleans(), st.text(), st.lists(st.integers()), st.none()
        ),
        min_size=5,
        max_size=5,
    ),
    st.sampled_from(["rgb8", "mono16", "", ["rgb8"], 5]),
)
def test_fields_of_another_type_that_has_these_names(values: list[Any], encoding: Any) -> None:
    named = dict(zip(("width", "height", "step", "is_bigendian", "format"), values, strict=True))
    message = ANY_IMAGE(**named, encoding=encoding, data=bytes(30))
    assert picture_of(message) is None or {type(named[one]) for one in ("width", "height", "step")} == {int}


def test_a_jpeg_that_does_not_come_to_its_size_is_not_searched_for_long() -> None:
    """Half a megabyte of fill bytes would cost as many steps, and half a second of the server's time."""

    class Counted(bytes):
        steps = 0

        def __getitem__(self, key: Any) -> Any:
            Counted.steps += 1
            return super().__getitem__(key)

    for filler in (b"\xff", b"\xff\xe0\x00\x00"):
        Counted.steps = 0
        assert pictures._sides(Counted(b"\xff\xd8" + filler * 20_000)) == (0, 0)
        assert Counted.steps < 10_000
