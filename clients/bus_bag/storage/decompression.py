"""Decompresses untrusted data: never to more than its announced size, and never to gigabytes."""

from bus_bag.storage.bag_file import Buffer
from bus_bag.storage.mcap_format import package

__all__ = ["MAX_SIZE", "decompress", "decompress_frame"]

MAX_SIZE = 256 << 20
"""Data with a larger announced size is not decompressed."""


def decompress(compression: str, data: Buffer, size: int) -> Buffer:
    """Decompress `data` to `size` bytes. Raises ValueError if it does not have that size."""
    if not compression:
        unpacked: Buffer = data
    elif size > MAX_SIZE:
        raise ValueError(f"it would be {size:,} bytes, more than {MAX_SIZE:,}")
    elif compression == "zstd":
        unpacked = _decompress_zstd(data, size)
    elif compression == "lz4":
        unpacked = _decompress_lz4(data, size)
    else:
        raise ValueError(f"its compression is '{compression}', neither 'zstd' nor 'lz4'")
    if len(unpacked) != size:
        raise ValueError(f"it has {len(unpacked):,} bytes, not {size:,}")
    return unpacked


def decompress_frame(data: Buffer) -> bytes:
    """Decompress a frame of zstd with an announced size. Raises ValueError if it is not one."""
    zstd = package("zstandard")
    try:
        size = zstd.frame_content_size(data)
    except zstd.ZstdError as error:
        raise ValueError(str(error)) from None
    if size < 0:
        raise ValueError("it does not say its size")
    return bytes(decompress("zstd", data, size))


def _decompress_zstd(data: Buffer, size: int) -> bytes:
    zstd = package("zstandard")
    try:
        told = zstd.frame_content_size(data)
        if told not in (-1, size):
            raise ValueError(f"it would be {told:,} bytes, not {size:,}")
        return bytes(zstd.ZstdDecompressor().decompress(data, max_output_size=size or 1))
    except zstd.ZstdError as error:
        raise ValueError(str(error)) from None


def _decompress_lz4(data: Buffer, size: int) -> bytes:
    lz4 = package("lz4.frame")
    try:
        return bytes(lz4.LZ4FrameDecompressor().decompress(bytes(data), max_length=size + 1))
    except (RuntimeError, EOFError, ValueError) as error:
        raise ValueError(str(error)) from None
