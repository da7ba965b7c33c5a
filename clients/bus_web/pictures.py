"""Images of messages, made small for the page. Pure, and without a library: rows and columns are left out."""

from typing import Any

__all__ = ["picture_of"]

_MOST_SIDE = 240
"""Pixels of the longer side of the shown picture."""
_MOST_COMPRESSED = 512 << 10
_MOST_PIXELS = 32 << 20
"""Limit for a compressed image: a browser needs four bytes for each pixel, however small the data is."""
_CHANNELS = {
    "rgb8": (3, (0, 1, 2)),
    "rgba8": (4, (0, 1, 2)),
    "bgr8": (3, (2, 1, 0)),
    "bgra8": (4, (2, 1, 0)),
    "8UC3": (3, (2, 1, 0)),
    "8UC4": (4, (2, 1, 0)),
    "mono8": (1, (0, 0, 0)),
    "8UC1": (1, (0, 0, 0)),
}
"""Encodings with a byte for each channel: bytes of a pixel, and the positions of red, green and blue."""
_WIDE = ("mono16", "16UC1", "16SC1")
_MOST_SEGMENTS = 1000
"""Limit of segments in a JPEG before its size; a fill byte counts as a segment."""
_KINDS = ((b"\xff\xd8\xff", "image/jpeg"), (b"\x89PNG\r\n", "image/png"))


def picture_of(message: Any) -> dict[str, Any] | None:
    """The page's picture of an Image or a CompressedImage; None for other types, or if it can't be drawn.

    `width`, `height` and `rgb`, with the size that it had in `of`; or of a compressed one `type` and `data`.
    Bytes are base64 in JSON.
    """
    fields = getattr(message, "__struct_fields__", ())
    if "data" not in fields or not isinstance(message.data, bytes | bytearray | memoryview):
        return None
    if "encoding" in fields and "step" in fields and "width" in fields and "height" in fields:
        return _raw(message)
    if "format" in fields:
        head = bytes(message.data[:8])
        kind = next((kind for begin, kind in _KINDS if head.startswith(begin)), None)
        if kind is not None and len(message.data) <= _MOST_COMPRESSED:
            width, height = _sides(bytes(message.data))
            if 0 < width * height <= _MOST_PIXELS:
                return {"type": kind, "data": message.data}
    return None


def _raw(image: Any) -> dict[str, Any] | None:
    width, height, step = image.width, image.height, image.step
    if not (all(type(one) is int for one in (width, height, step)) and isinstance(image.encoding, str)):
        return None  # another type, with fields of these names
    size, order = _CHANNELS.get(image.encoding, (2, (0, 0, 0)))
    is_wide = image.encoding in _WIDE
    if not is_wide and image.encoding not in _CHANNELS:
        return None
    if not (width > 0 and height > 0 and width * size <= step and step * height <= len(image.data)):
        return None
    each = -(-max(width, height) // _MOST_SIDE)
    columns, rows = -(-width // each), -(-height // each)
    data = memoryview(image.data).cast("B")
    high = 0 if image.is_bigendian else 1  # position of the more significant of two bytes
    rgb = bytearray(3 * columns * rows)
    for row in range(rows):
        begin = row * each * step
        line = bytes(data[begin : begin + width * size])
        at = 3 * columns * row
        for channel, where in enumerate(order):
            picked = line[high if is_wide else where :: size * each]
            rgb[at + channel : at + 3 * columns : 3] = picked
    return {"width": columns, "height": rows, "of": [width, height], "rgb": rgb}


def _sides(data: bytes) -> tuple[int, int]:
    """Width and height from the head of a PNG or a JPEG; zeros if they are missing."""
    if data.startswith(b"\x89PNG"):
        return int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    at = 2
    for _ in range(_MOST_SEGMENTS):  # each with its length
        if data[at : at + 1] != b"\xff" or len(data) < at + 9:
            break
        kind = data[at + 1]
        if kind == 0xFF:  # a fill byte
            at += 1
            continue
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            return int.from_bytes(data[at + 7 : at + 9]), int.from_bytes(data[at + 5 : at + 7])
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    return 0, 0
