"""encodings: the layout of each, and the conversions between them. The texts are cv_bridge's."""

import pytest

from bus_ros.cv_bridge.encodings import Color, CvBridgeError, Depth, Format, format_of, steps
from rows import for_each


@for_each(
    ("encoding", "dtype", "channels"),
    [
        ("mono8", "uint8", 1),
        ("bgr16", "uint16", 3),
        ("rgba8", "uint8", 4),
        ("bayer_gbrg16", "uint16", 1),
        ("yuv422", "uint8", 2),
        ("yuyv", "uint8", 2),
        ("8UC1", "uint8", 1),
        ("8SC2", "int8", 2),
        ("16SC3", "int16", 3),
        ("32SC4", "int32", 4),
        ("64FC10", "float64", 10),
        ("32F", "float32", 1),
    ],
)
def test_a_format(encoding: str, dtype: str, channels: int) -> None:
    assert format_of(encoding)[:2] == Format(dtype, channels)[:2]


@for_each("encoding", ["", "rgb", "8UC0", "8UC", "32UC1", "mono32", "8UC1 "])
def test_what_is_no_encoding(encoding: str) -> None:
    with pytest.raises(CvBridgeError) as caught:
        format_of(encoding)
    assert str(caught.value) == f"Unrecognized image encoding [{encoding}]"


@for_each(
    ("source", "target", "way"),
    [
        ("bgr8", "bgr8", []),
        ("bgr8", "rgb8", ["COLOR_BGR2RGB"]),
        ("rgba8", "mono8", ["COLOR_RGBA2GRAY"]),
        ("mono8", "bgr8", ["COLOR_GRAY2BGR"]),
        ("uyvy", "bgr8", ["COLOR_YUV2BGR_UYVY"]),
        ("yuv422_yuy2", "mono8", ["COLOR_YUV2GRAY_YUY2"]),
        ("bayer_rggb8", "rgb8", ["COLOR_BayerBG2RGB"]),
        ("bayer_grbg16", "bgr8", ["COLOR_BayerGB2BGR", ("uint8", 255 / 65535)]),
        ("bgr8", "bgr16", [("uint16", 257.0)]),
        ("mono16", "mono8", [("uint8", 255 / 65535)]),
        ("bgr8", "8UC3", [("uint8", 1.0)]),
        ("16UC1", "32FC1", [("float32", 1.0)]),
        ("8UC1", "16SC1", [("int16", 257.0)]),
    ],
)
def test_a_way(source: str, target: str, way: list[object]) -> None:
    found = steps(source, target)
    assert [step.code if isinstance(step, Color) else tuple(step) for step in found] == way
    assert all(isinstance(step, Color | Depth) for step in found)


@for_each(
    ("source", "target", "text"),
    [
        ("8UC1", "mono8", "[8UC1] is not a color format. but [mono8] is. The conversion does not make sense"),
        ("8UC1", "8UC3", "[8UC1] and [8UC3] do not have the same number of channel"),
        (
            "bgr8",
            "8UC1",
            "[bgr8] is a color format but [8UC1] is not so they must have the same OpenCV type, CV_8UC3, "
            "CV16UC1 ....",
        ),
        ("bayer_rggb8", "rgba8", "Unsupported conversion from [bayer_rggb8] to [rgba8]"),
        ("bgr8", "yuyv", "Unsupported conversion from [bgr8] to [yuyv]"),
        ("bgr8", "bgr", "Unrecognized image encoding [bgr]"),
    ],
)
def test_no_way(source: str, target: str, text: str) -> None:
    with pytest.raises(CvBridgeError) as caught:
        steps(source, target)
    assert str(caught.value) == text
