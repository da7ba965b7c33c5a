"""The types of the native core."""

from typing import TypeAlias

Buffer: TypeAlias = bytes | bytearray | memoryview

class Program:
    """The operations for one message type, as `program.h` describes them. Raises ValueError for others."""

    def __new__(cls, operations: Buffer, /) -> Program: ...
    def records(
        self, pack: bytes, channel: int, log_time: int, base: int, /
    ) -> tuple[bytearray, bytes] | None:
        """The MCAP message records of packed messages, and their index: log time and offset of each.

        `base` is the offset of the first record. Returns None if a message is refused, or if the pack is cut
        off.
        """
    def messages(self, payloads: tuple[Buffer, ...], /) -> list[bytes] | None:
        """The CDR message of each payload. Returns None if one is refused."""

def crc32(data: Buffer, value: int = 0, /) -> int:
    """As zlib.crc32. Missing on processors without fast instructions for it."""
