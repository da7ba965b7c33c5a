"""The encodings of images, and the steps from one to another. Pure: no pixels, no OpenCV.

    kind        encodings, 8 and 16 bits                       converts to
    GRAY        mono8 mono16                                   GRAY RGB BGR RGBA BGRA
    RGB, ...    rgb8 bgr8 rgba8 bgra8 rgb16 ...                GRAY RGB BGR RGBA BGRA
    UYVY, YUY2  uyvy yuv422; yuyv yuv422_yuy2                  GRAY RGB BGR RGBA BGRA
    BayerBG...  bayer_rggb8 bayer_bggr8 bayer_gbrg8 ... 16     GRAY RGB BGR
    none        8UC1 ... 64FC4, 8U, 8UC10                      any encoding with as many channels and no kind

An encoding with a kind also converts to encodings with as many channels and no kind. Kinds have the names in
OpenCV's codes: for a Bayer pattern, the name is its second row from the second column on.
"""

import re
from typing import Final, NamedTuple

__all__ = ["DEPTHS", "Color", "CvBridgeError", "Depth", "Format", "format_of", "steps"]


class CvBridgeError(TypeError):
    """An image that can't be converted; the text says why."""


class Format(NamedTuple):
    """The storage of pixels in an encoding."""

    dtype: str
    """NumPy's name of a channel's type."""
    channels: int
    kind: str | None = None
    """The meaning of the channels; None: the encoding does not define it."""

    @property
    def bits(self) -> int:
        return int(re.sub(r"\D", "", self.dtype))


class Color(NamedTuple):
    """A step: OpenCV's conversion of that name, at the same depth."""

    code: str
    source: str
    target: str


class Depth(NamedTuple):
    """A step: to numbers of type `dtype`, each times `scale`, rounded and cut off at its limits."""

    dtype: str
    scale: float


DEPTHS: Final = {
    "8U": "uint8",
    "8S": "int8",
    "16U": "uint16",
    "16S": "int16",
    "32S": "int32",
    "32F": "float32",
    "64F": "float64",
}
"""OpenCV's names of depths to NumPy's, in the order of OpenCV's numbers for them (32F is 5)."""

_PLAIN: Final = {
    "mono": ("GRAY", 1),
    "rgb": ("RGB", 3),
    "bgr": ("BGR", 3),
    "rgba": ("RGBA", 4),
    "bgra": ("BGRA", 4),
}
_BAYER: Final = {"rggb": "BayerBG", "bggr": "BayerRG", "gbrg": "BayerGR", "grbg": "BayerGB"}
_YUV: Final = {"uyvy": "UYVY", "yuv422": "UYVY", "yuyv": "YUY2", "yuv422_yuy2": "YUY2"}
_NAMED: Final = {
    **{
        f"{name}{bits}": Format(f"uint{bits}", channels, kind)
        for name, (kind, channels) in _PLAIN.items()
        for bits in (8, 16)
    },
    **{
        f"bayer_{name}{bits}": Format(f"uint{bits}", 1, kind)
        for name, kind in _BAYER.items()
        for bits in (8, 16)
    },
    **{name: Format("uint8", 2, kind) for name, kind in _YUV.items()},
}
_GENERIC: Final = re.compile(rf"({'|'.join(DEPTHS)})(?:C([1-9]\d{{0,2}}))?")
_PLAIN_KINDS: Final = tuple(kind for kind, _ in _PLAIN.values())


def format_of(encoding: str) -> Format:
    """The format of an encoding; raises CvBridgeError for an unknown one."""
    if (named := _NAMED.get(encoding)) is not None:
        return named
    if (found := _GENERIC.fullmatch(encoding)) is None:
        raise CvBridgeError(f"Unrecognized image encoding [{encoding}]")
    return Format(DEPTHS[found[1]], int(found[2] or 1))


def steps(source: str, target: str) -> list[Color | Depth]:
    """The steps from one encoding to another, in order; none if they are the same.

    Raises CvBridgeError, with cv_bridge's texts, if there is no conversion.
    """
    if source == target:
        return []
    old, new = format_of(source), format_of(target)
    is_same_size = old.channels == new.channels
    if old.kind is None and new.kind is not None:
        raise CvBridgeError(
            f"[{source}] is not a color format. but [{target}] is. The conversion does not make sense"
        )
    if old.kind is None and not is_same_size:
        raise CvBridgeError(f"[{source}] and [{target}] do not have the same number of channel")
    if new.kind is None and not is_same_size:
        raise CvBridgeError(
            f"[{source}] is a color format but [{target}] is not so they must have the same OpenCV type, "
            "CV_8UC3, CV16UC1 ...."
        )
    depth = Depth(new.dtype, _SCALES.get((old.bits, new.bits), 1.0))
    if old.kind is None or new.kind is None or old.kind == new.kind:
        return [depth]
    color = _color(old.kind, new.kind)
    if color is None:
        raise CvBridgeError(f"Unsupported conversion from [{source}] to [{target}]")
    return [color] if old.dtype == new.dtype else [color, depth]


_SCALES: Final = {(8, 16): 65535 / 255, (16, 8): 255 / 65535}
"""White stays white between 8 and 16 bits. No other two depths are scaled."""


def _color(old: str, new: str) -> Color | None:
    if new not in _PLAIN_KINDS:
        return None
    if old in _PLAIN_KINDS:
        return Color(f"COLOR_{old}2{new}", old, new)
    if old in _YUV.values():
        return Color(f"COLOR_YUV2{new}_{old}", old, new)
    return Color(f"COLOR_{old}2{new}", old, new) if not new.endswith("A") else None
