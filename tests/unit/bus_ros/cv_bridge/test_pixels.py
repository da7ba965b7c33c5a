"""Conversions and compressed images with OpenCV. OpenCV also checks the results of NumPy alone."""

from typing import Any

import pytest

from bus_ros.cv_bridge import CvBridge, CvBridgeError, pixels
from bus_ros.cv_bridge.encodings import Color, Depth, steps
from rows import for_each

np = pytest.importorskip("numpy")
cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: make test-nightly installs it")
BRIDGE = CvBridge()
PLAIN = ("mono8", "rgb8", "bgr8", "rgba8", "bgra8", "mono16", "rgb16", "bgra16")
PACKED = ("uyvy", "yuv422", "yuyv", "yuv422_yuy2")
BAYER = ("bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg16")


def noise(encoding: str) -> Any:
    dtype, channels = BRIDGE.encoding_to_dtype_with_channels(encoding)
    shape = (6, 8, channels) if channels > 1 else (6, 8)
    return np.random.default_rng(1).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)


def test_all_conversions() -> None:
    for source in (*PLAIN, *PACKED, *BAYER):
        message = BRIDGE.cv2_to_imgmsg(noise(source), source)
        for target in PLAIN:
            if source in BAYER and "a" in target:
                continue
            image = BRIDGE.imgmsg_to_cv2(message, target)
            dtype, channels = BRIDGE.encoding_to_dtype_with_channels(target)
            assert (image.dtype.name, image.shape) == (dtype, (6, 8, channels) if channels > 1 else (6, 8))


def test_colors_are_the_right_ones() -> None:
    red = BRIDGE.cv2_to_imgmsg(np.full((4, 4, 3), (255, 0, 0), np.uint8), "rgb8")
    assert BRIDGE.imgmsg_to_cv2(red, "bgr8")[0, 0].tolist() == [0, 0, 255]
    assert BRIDGE.imgmsg_to_cv2(red, "mono8")[0, 0] == 76
    # A Bayer image with red only: blocks of two by two, R G over G B.
    mosaic = np.zeros((6, 6), np.uint8)
    mosaic[::2, ::2] = 255
    bayer = BRIDGE.cv2_to_imgmsg(mosaic, "bayer_rggb8")
    assert BRIDGE.imgmsg_to_cv2(bayer, "rgb8")[2, 2].tolist() == [255, 0, 0]
    grey = BRIDGE.cv2_to_imgmsg(np.full((2, 2, 2), (128, 235), np.uint8), "uyvy")
    assert BRIDGE.imgmsg_to_cv2(grey, "rgb8")[0, 0].tolist() == [255, 255, 255]
    assert BRIDGE.imgmsg_to_cv2(grey, "mono8")[0, 0] == 235


@for_each("source", [name for name in PLAIN if name.endswith("8")])
def test_numpy_does_as_opencv(source: str) -> None:
    image = noise(source)
    for target in PLAIN:
        for step in steps(source, target):
            if isinstance(step, Color) and step.target != "GRAY":
                assert (pixels._reordered(step, image) == pixels.apply(step, image)).all(), (source, target)


@for_each(("source", "dtype", "scale"), [("uint16", "uint8", 255 / 65535), ("float32", "uint8", 1.0)])
def test_depths_are_as_opencv_has_them(source: str, dtype: str, scale: float) -> None:
    values = np.linspace(0, 65535 if source == "uint16" else 300, 70_000).astype(source)
    found = pixels.apply(Depth(dtype, scale), values)
    assert (found == cv2.convertScaleAbs(values, alpha=scale).ravel()).all()


@for_each("encoding", ["mono8", "bgr8", "mono16", "bgra8"])
def test_compressed(encoding: str) -> None:
    image = noise(encoding)
    message = BRIDGE.cv2_to_compressed_imgmsg(image, "png")
    assert message.format == "png"
    assert (BRIDGE.compressed_imgmsg_to_cv2(message) == image).all()
    assert BRIDGE.compressed_imgmsg_to_cv2(message, "rgb8").shape == (6, 8, 3)


def test_what_is_refused() -> None:
    message = BRIDGE.cv2_to_compressed_imgmsg(noise("bgr8"))
    assert (message.format, bytes(message.data[:2])) == ("jpg", b"\xff\xd8")
    message.data = b"nonsense"
    with pytest.raises(CvBridgeError, match="8 bytes of format 'jpg' can't be decoded"):
        BRIDGE.compressed_imgmsg_to_cv2(message)
    message.data = b""
    with pytest.raises(CvBridgeError, match="0 bytes of format 'jpg' can't be decoded"):
        BRIDGE.compressed_imgmsg_to_cv2(message)
    with pytest.raises(CvBridgeError, match="could not find"):
        BRIDGE.cv2_to_compressed_imgmsg(noise("bgr8"), "xyz")
    odd = BRIDGE.cv2_to_imgmsg(np.zeros((2, 3, 2), np.uint8), "uyvy")
    with pytest.raises(CvBridgeError):
        BRIDGE.imgmsg_to_cv2(odd, "rgb8")


def test_types_by_number() -> None:
    for name in ("8UC1", "8UC3", "16SC2", "64FC4"):
        number = getattr(cv2, f"CV_{name}")
        assert BRIDGE.encoding_to_cvtype2(name) == number
        assert BRIDGE.cvtype_to_name[number] == name
        assert BRIDGE.cvtype2_to_dtype_with_channels(number) == BRIDGE.encoding_to_dtype_with_channels(name)
