"""CvBridge: converts messages with images to OpenCV's arrays, and back.

Must not know topics. All conversions need NumPy. Compressed images and conversions that compute (`pixels`)
also need OpenCV. Messages may be of any class with the fields of sensor_msgs/msg/Image.
"""

import sys
from array import array
from typing import TYPE_CHECKING, Any

from bus_ros.cv_bridge import pixels
from bus_ros.cv_bridge.encodings import DEPTHS, CvBridgeError, format_of, steps
from bus_ros.extras import extra
from bus_ros.rosidl import message_class

if TYPE_CHECKING:
    import numpy as np

    Image = np.ndarray[Any, Any]

__all__ = ["CvBridge", "CvBridgeError"]

_OPENCV4_SHIFT = 3
"""Position of the channels in OpenCV's number of a type; 5 in OpenCV 5."""


class CvBridge:
    """Converts images. It has no state."""

    numpy_type_to_cvtype = {**{kind: name for name, kind in DEPTHS.items()}, **DEPTHS}  # noqa: RUF012

    @property
    def cvtype_to_name(self) -> dict[int, str]:
        """OpenCV's types by their numbers: 16 is `8UC3` in OpenCV 4, 64 in OpenCV 5."""
        names = [f"{depth}C{channels}" for depth in DEPTHS for channels in range(1, 5)]
        return {self.encoding_to_cvtype2(name): name for name in names}

    def dtype_with_channels_to_cvtype2(self, dtype: "np.dtype[Any]", n_channels: int) -> str:
        """The type's name: `8UC3` for 3 channels of uint8.

        Raises CvBridgeError for a number type that images can't have.
        """
        if dtype.name not in self.numpy_type_to_cvtype:
            raise CvBridgeError(f"an image can't be of {dtype.name}: it is of {', '.join(DEPTHS.values())}")
        return f"{self.numpy_type_to_cvtype[dtype.name]}C{n_channels}"

    def cvtype2_to_dtype_with_channels(self, cvtype: int) -> tuple[str, int]:
        """NumPy's name of a channel's type, and the number of channels, from OpenCV's number of a type."""
        shift = _channel_shift()
        depth = cvtype & ((1 << shift) - 1)
        if cvtype < 0 or depth >= len(DEPTHS):
            raise CvBridgeError(f"{cvtype} is not a type of images")
        return list(DEPTHS.values())[depth], (cvtype >> shift) + 1

    def encoding_to_cvtype2(self, encoding: str) -> int:
        """OpenCV's number of the type; raises CvBridgeError for an unknown encoding."""
        found = format_of(encoding)
        return list(DEPTHS.values()).index(found.dtype) + ((found.channels - 1) << _channel_shift())

    def encoding_to_dtype_with_channels(self, encoding: str) -> tuple[str, int]:
        """NumPy's name of a channel's type, and the number of channels; raises as `encoding_to_cvtype2`."""
        found = format_of(encoding)
        return found.dtype, found.channels

    def imgmsg_to_cv2(self, img_msg: Any, desired_encoding: str = "passthrough") -> "Image":
        """The image as an array: height x width, and x channels if there are several.

        With `passthrough` it is a view of the message's data, if the data are in this machine's byte order
        and rows have no padding: drawing on the array changes the message. With an encoding it is always a
        copy. Raises CvBridgeError for inconsistent sizes, and for an unknown encoding or conversion.
        """
        image = _pixels_of(img_msg)
        if desired_encoding == "passthrough":
            return image
        return _converted(image, img_msg.encoding, desired_encoding or img_msg.encoding)

    def compressed_imgmsg_to_cv2(self, cmprs_img_msg: Any, desired_encoding: str = "passthrough") -> "Image":
        """The image in a CompressedImage; with `passthrough` as it was saved, colors in the order BGR.

        Raises CvBridgeError for invalid data, and as `imgmsg_to_cv2`.
        """
        np, cv2 = extra("numpy", "cv_bridge"), extra("cv2", "cv_bridge with compressed images")
        data = np.frombuffer(cmprs_img_msg.data, np.uint8)
        try:
            image: Image | None = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if len(data) else None
        except cv2.error as error:
            raise CvBridgeError(str(error).strip()) from error
        if image is None:
            raise CvBridgeError(f"{len(data)} bytes of format '{cmprs_img_msg.format}' can't be decoded")
        if desired_encoding == "passthrough":
            return image
        name = {1: "mono", 3: "bgr", 4: "bgra"}[image.shape[2] if image.ndim == 3 else 1]
        return _converted(image, f"{name}{8 * image.itemsize}", desired_encoding)

    def cv2_to_imgmsg(self, cvim: "Image", encoding: str = "passthrough", header: Any = None) -> Any:
        """An Image message with a copy of the array; `passthrough`: with the array's type as its encoding.

        The pixels are not converted, so they have to be in the encoding's order. Raises TypeError for
        anything but an array, CvBridgeError if the encoding does not have the array's type.
        """
        _check_array(cvim)
        if cvim.ndim not in (2, 3):
            raise CvBridgeError(f"an image has 2 or 3 dimensions, and this array {cvim.ndim}")
        height, width, channels = (*cvim.shape, 1)[:3]
        kind = self.dtype_with_channels_to_cvtype2(cvim.dtype, channels)
        if encoding != "passthrough":
            dtype, wanted = self.encoding_to_dtype_with_channels(encoding)
            if (dtype, wanted) != (cvim.dtype.name, channels):
                raise CvBridgeError(
                    f"encoding specified as {encoding}, but image has incompatible type {kind}"
                )
        message: Any = message_class("sensor_msgs/msg/Image")
        return message(
            **({} if header is None else {"header": header}),
            height=height,
            width=width,
            encoding=kind if encoding == "passthrough" else encoding,
            is_bigendian=int(cvim.itemsize > 1 and cvim.dtype.isnative == (sys.byteorder == "big")),
            step=width * channels * cvim.itemsize,
            data=_bytes_of(cvim),
        )

    def cv2_to_compressed_imgmsg(self, cvim: "Image", dst_format: str = "jpg") -> Any:
        """A CompressedImage of the array (colors in the order BGR), in a format that OpenCV writes.

        Raises TypeError for anything but an array, CvBridgeError if OpenCV can't write it.
        """
        _check_array(cvim)
        cv2 = extra("cv2", "cv_bridge with compressed images")
        try:
            is_done, data = cv2.imencode(f".{dst_format}", cvim)
        except cv2.error as error:
            raise CvBridgeError(str(error).strip()) from error
        if not is_done:
            raise CvBridgeError(f"OpenCV can't write this image as '{dst_format}'")
        message: Any = message_class("sensor_msgs/msg/CompressedImage")
        return message(format=dst_format, data=_bytes_of(data))


def _channel_shift() -> int:
    opencv = pixels.cv2()
    return _OPENCV4_SHIFT if opencv is None else int(opencv.CV_8UC2).bit_length() - 1


def _check_array(cvim: object) -> None:
    np = extra("numpy", "cv_bridge")
    if not isinstance(cvim, np.ndarray):
        raise TypeError("Your input type is not a numpy array")


def _bytes_of(image: "Image") -> "array[int]":
    np = extra("numpy", "cv_bridge")
    data = array("B")
    if image.size:
        data.frombytes(np.ascontiguousarray(image).view(np.uint8))
    return data


def _pixels_of(message: Any) -> "Image":
    """The pixels of an Image message, in this machine's byte order, without padding between rows."""
    np = extra("numpy", "cv_bridge")
    found = format_of(message.encoding)
    kind = np.dtype(found.dtype)
    height, width, step, size = message.height, message.width, message.step, len(message.data)
    if step < width * kind.itemsize * found.channels:
        raise CvBridgeError(
            "Image is wrongly formed: step < width * byte_depth * num_channels  or  "
            f"{step} != {width} * {kind.itemsize} * {found.channels}"
        )
    if height * step != size:
        raise CvBridgeError(
            f"Image is wrongly formed: height * step != size  or  {height} * {step} != {size}"
        )
    if bool(message.is_bigendian) != (sys.byteorder == "big"):
        kind = kind.newbyteorder()
    pixel = kind.itemsize * found.channels
    shape: tuple[int, ...] = (height, width)
    strides: tuple[int, ...] = (step, pixel)
    if found.channels > 1:
        shape, strides = (*shape, found.channels), (*strides, kind.itemsize)
    image = np.ascontiguousarray(np.ndarray(shape, kind, message.data, strides=strides))
    same: Image = image if kind.isnative else image.astype(kind.newbyteorder("="))
    return same


def _converted(image: "Image", source: str, target: str) -> "Image":
    way = steps(source, target)
    if not way:
        return image.copy()
    for step in way:
        image = pixels.apply(step, image)
    return image
