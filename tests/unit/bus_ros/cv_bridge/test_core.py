"""CvBridge without OpenCV: images to and from messages, and refusals."""

import sys
from collections.abc import Iterator
from typing import Any

import pytest

from bus.msg import sensor_msgs
from bus_ros.cv_bridge import CvBridge, CvBridgeError, pixels
from bus_ros.rosidl import message_class
from rows import for_each

np = pytest.importorskip("numpy")
Image: Any = message_class("sensor_msgs/msg/Image")
BRIDGE = CvBridge()


@pytest.fixture(autouse=True)
def _without_opencv(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setitem(sys.modules, "cv2", None)
    pixels.cv2.cache_clear()
    yield
    pixels.cv2.cache_clear()


def colors(dtype: str = "uint8", channels: int = 3) -> Any:
    return np.arange(2 * 3 * channels).reshape(2, 3, channels).astype(dtype)


@for_each(
    ("encoding", "dtype", "shape"),
    [
        ("bgr8", "uint8", (2, 3, 3)),
        ("mono16", "uint16", (2, 3)),
        ("32FC1", "float32", (2, 3)),
        ("64FC4", "float64", (2, 3, 4)),
        ("8SC2", "int8", (2, 3, 2)),
        ("bayer_rggb8", "uint8", (2, 3)),
        ("uyvy", "uint8", (2, 3, 2)),
    ],
)
def test_there_and_back(encoding: str, dtype: str, shape: tuple[int, ...]) -> None:
    image = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    message = BRIDGE.cv2_to_imgmsg(image, encoding)
    assert (message.height, message.width, message.encoding) == (2, 3, encoding)
    assert (message.step, message.is_bigendian) == (image[0].nbytes, sys.byteorder == "big")
    found = BRIDGE.imgmsg_to_cv2(message)
    assert (found.dtype, found.shape, found.tolist()) == (image.dtype, shape, image.tolist())
    same = BRIDGE.imgmsg_to_cv2(message, encoding)
    same[:] = 0
    assert BRIDGE.imgmsg_to_cv2(message).tolist() == image.tolist()


def test_passthrough_names_the_type_and_takes_any_array() -> None:
    header = message_class("std_msgs/msg/Header")(frame_id="camera")  # type: ignore[call-arg]
    image = colors("int16")
    message = BRIDGE.cv2_to_imgmsg(image[:, ::2], header=header)
    assert (message.encoding, message.width, message.header.frame_id) == ("16SC3", 2, "camera")
    assert BRIDGE.imgmsg_to_cv2(message).tolist() == image[:, ::2].tolist()
    assert BRIDGE.cv2_to_imgmsg(image[..., :1]).encoding == "16SC1"
    empty = BRIDGE.cv2_to_imgmsg(np.zeros((0, 4), np.uint8), "mono8")
    assert BRIDGE.imgmsg_to_cv2(empty).shape == (0, 4)


def test_passthrough_gives_a_view() -> None:
    message = BRIDGE.cv2_to_imgmsg(colors(), "bgr8")
    BRIDGE.imgmsg_to_cv2(message)[0, 0] = 255
    assert bytes(message.data[:4]) == b"\xff\xff\xff\x03"
    native = sensor_msgs.Image(height=1, width=2, encoding="mono8", step=2, data=b"ab")
    assert not BRIDGE.imgmsg_to_cv2(native).flags.writeable


def test_rows_with_padding() -> None:
    message = Image(height=2, width=3, encoding="mono8", step=5, data=b"abc..def..")
    assert BRIDGE.imgmsg_to_cv2(message).tobytes() == b"abcdef"
    message = Image(height=2, width=1, encoding="rgb8", step=4, data=b"abc.def.")
    assert BRIDGE.imgmsg_to_cv2(message, "bgr8").tobytes() == b"cbafed"


def test_another_byte_order() -> None:
    image = colors("uint16")
    message = BRIDGE.cv2_to_imgmsg(image.astype(image.dtype.newbyteorder()), "rgb16")
    assert message.is_bigendian == (sys.byteorder == "little")
    found = BRIDGE.imgmsg_to_cv2(message)
    assert found.tolist() == image.tolist()
    assert found.dtype.isnative


@for_each(
    ("source", "target", "pixel", "found"),
    [
        ("bgr8", "rgb8", [1, 2, 3], [3, 2, 1]),
        ("bgra8", "rgba8", [1, 2, 3, 4], [3, 2, 1, 4]),
        ("rgb8", "bgra8", [1, 2, 3], [3, 2, 1, 255]),
        ("rgba8", "rgb8", [1, 2, 3, 4], [1, 2, 3]),
        ("mono16", "rgba16", 7, [7, 7, 7, 65535]),
        ("rgb8", "bgr16", [0, 1, 255], [65535, 257, 0]),
        ("mono16", "mono8", 65535, 255),
        ("mono16", "8UC1", 300, 1),
        ("mono8", "mono16", 128, 128 * 257),
        ("32FC1", "8UC1", 2.5, 2),
        ("32FC1", "8UC1", 300.0, 255),
        ("32FC1", "16SC1", float("nan"), 0),
        ("16SC1", "32FC1", -7, -7.0),
        ("16SC1", "8SC1", 32767, 127),
    ],
)
def test_conversions_that_need_no_opencv(source: str, target: str, pixel: Any, found: Any) -> None:
    dtype, _ = BRIDGE.encoding_to_dtype_with_channels(source)
    message = BRIDGE.cv2_to_imgmsg(np.array([[pixel] * 2], dtype), source)
    image = BRIDGE.imgmsg_to_cv2(message, target)
    assert image[0, 1].tolist() == found
    assert image.dtype.name == BRIDGE.encoding_to_dtype_with_channels(target)[0]


@for_each("target", ["mono8", "mono16"])
def test_conversions_that_need_opencv(target: str) -> None:
    with pytest.raises(ModuleNotFoundError) as caught:
        BRIDGE.imgmsg_to_cv2(BRIDGE.cv2_to_imgmsg(colors(), "bgr8"), target)
    assert str(caught.value) == (
        "cv_bridge from BGR to GRAY needs OpenCV: pip install 'opencv-python-headless>=4.8'"
    )
    with pytest.raises(ModuleNotFoundError, match="compressed images needs OpenCV"):
        BRIDGE.cv2_to_compressed_imgmsg(colors())


def test_types_by_number() -> None:
    assert BRIDGE.encoding_to_cvtype2("bgr8") == 16
    assert BRIDGE.encoding_to_cvtype2("32FC1") == 5
    assert BRIDGE.cvtype2_to_dtype_with_channels(16) == ("uint8", 3)
    assert BRIDGE.cvtype_to_name[16] == "8UC3"
    assert BRIDGE.dtype_with_channels_to_cvtype2(np.dtype("float64"), 2) == "64FC2"
    with pytest.raises(CvBridgeError, match="7 is not a type of images"):
        BRIDGE.cvtype2_to_dtype_with_channels(7)


@for_each(
    ("fields", "text"),
    [
        (
            {"step": 8},
            "Image is wrongly formed: step < width * byte_depth * num_channels  or  8 != 3 * 1 * 3",
        ),
        ({"step": 10}, "Image is wrongly formed: height * step != size  or  2 * 10 != 18"),
        ({"data": b"abc"}, "Image is wrongly formed: height * step != size  or  2 * 9 != 3"),
        ({"encoding": "rgb"}, "Unrecognized image encoding [rgb]"),
    ],
)
def test_messages_that_are_refused(fields: dict[str, Any], text: str) -> None:
    message = BRIDGE.cv2_to_imgmsg(colors(), "rgb8")
    for name, value in fields.items():
        setattr(message, name, value)
    with pytest.raises(CvBridgeError) as caught:
        BRIDGE.imgmsg_to_cv2(message, "bgr8")
    assert str(caught.value) == text


def test_arrays_that_are_refused() -> None:
    nonsense: Any = [[1, 2]]
    for convert in (BRIDGE.cv2_to_imgmsg, BRIDGE.cv2_to_compressed_imgmsg):
        with pytest.raises(TypeError, match="Your input type is not a numpy array"):
            convert(nonsense)
    with pytest.raises(
        CvBridgeError, match="encoding specified as mono8, but image has incompatible type 8UC3"
    ):
        BRIDGE.cv2_to_imgmsg(colors(), "mono8")
    with pytest.raises(CvBridgeError, match="an image can't be of int64: it is of uint8, int8, "):
        BRIDGE.cv2_to_imgmsg(colors("int64"))
    with pytest.raises(CvBridgeError, match="an image has 2 or 3 dimensions, and this array 1"):
        BRIDGE.cv2_to_imgmsg(np.zeros(3, np.uint8))
