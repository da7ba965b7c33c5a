"""Images made small: the order of colours, rows with padding, what can't be drawn."""

from typing import Any

from bus.msg.sensor_msgs import CompressedImage, Image
from bus_web import pictures
from rows import for_each


def picture_of(message: Any) -> Any:
    return pictures.picture_of(message)


PIXELS = {  # one red pixel, one of (1, 2, 3)
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
    ],
)
def test_what_can_not_be_drawn(image: Image | CompressedImage) -> None:
    assert picture_of(image) is None


def test_compressed_ones_go_as_they_are() -> None:
    picture = picture_of(CompressedImage(format="whatever", data=b"\xff\xd8\xff\xe0abc"))
    assert (picture["type"], picture["data"]) == ("image/jpeg", b"\xff\xd8\xff\xe0abc")
