"""The hash of a message type as rclpy shows it. Owns its text; must not know its computation."""

__all__ = ["TypeHash"]

_SIZE = 32


class TypeHash:
    """`version` is the algorithm of the 32 bytes in `value`; -1: unknown."""

    __slots__ = ("_value", "_version")

    def __init__(self, version: int = -1, value: bytes = bytes(_SIZE)) -> None:
        self.version = version
        self.value = value

    @classmethod
    def parse(cls, text: str) -> "TypeHash":
        """From `RIHS01_<64 hex digits>`; other texts, such as hashes of busd's own types, are unknown."""
        prefix, _, digits = text.partition("_")
        if not prefix.startswith("RIHS"):
            return cls()
        try:
            return cls(int(prefix[4:]), bytes.fromhex(digits))
        except ValueError:
            return cls()

    @property
    def version(self) -> int:
        return self._version

    @version.setter
    def version(self, value: int) -> None:
        assert isinstance(value, int)
        self._version = value

    @property
    def value(self) -> bytes:
        return self._value

    @value.setter
    def value(self, value: bytes) -> None:
        assert isinstance(value, bytes)
        self._value = value

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TypeHash):
            return False
        return (self._version, self._value) == (other._version, other._value)

    def __hash__(self) -> int:
        return hash((self._version, self._value))

    def __str__(self) -> str:
        if self._version <= 0 or len(self._value) != _SIZE:
            return "INVALID"
        return f"RIHS{self._version:02}_{self._value.hex()}"

    def __repr__(self) -> str:
        return f"TypeHash({self})"
