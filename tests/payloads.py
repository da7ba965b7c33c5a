"""Values of any message type from its schema, as MessagePack."""

import random
import struct
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from bus.types.schema_form import Node

__all__ = ["Filler", "payload"]

_INTEGERS: Final = {
    "char": (0, 255),
    "int": (-(2**63), 2**63 - 1),
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
_TEXTS: Final = ("", "a", "base_link", "Größe 3 µm", "x" * 37, "中文")


def payload(description: Mapping[str, Any], seed: int) -> bytes:
    """A message with random values; the same for the same seed."""
    return msgspec.msgpack.encode(Filler(description, random.Random(seed)).value(description["root"]))


class Filler:
    """Random values of the types of one schema."""

    def __init__(self, description: Mapping[str, Any], chance: random.Random) -> None:
        self._types = description["types"]
        self._chance = chance

    def value(self, node: Node) -> Any:
        chance = self._chance
        match node:
            case str() if "/" in node:
                return self._message(self._types[node])
            case str() if node in _INTEGERS:
                least, most = _INTEGERS[node]
                return chance.choice((least, most, 0, 1, chance.randint(least, most)))
            case "bool":
                return chance.random() < 0.5
            case "float32":
                return struct.unpack("f", struct.pack("f", chance.uniform(-1000, 1000)))[0]
            case "float64":
                return chance.choice((0.0, -0.0, 1e300, chance.uniform(-1000, 1000)))
            case "byte":
                return chance.randbytes(1)
            case "uint8[]" | "byte[]":
                return chance.randbytes(chance.choice((0, 1, 7, 100)))
            case "string" | ["string", _]:
                text = chance.choice(_TEXTS)
                return text if isinstance(node, str) else text[: node[1]]
            case ["bytes", least, most, *_]:
                return chance.randbytes(self._count(least, most))
            case ["list", item, *bounds]:
                return [self.value(item) for _ in range(self._count(*bounds))]
            case ["dict", key, value]:
                key = "string" if key == "any" else key
                return {self.value(key): self.value(value) for _ in range(self._count())}
            case ["union", *members]:
                return self.value(chance.choice([member for member in members if member != "unset"]))
            case ["tuple", *items]:
                return [self.value(item) for item in items]
            case ["literal", *values]:
                return chance.choice(values)
            case "none":
                return None
            case "any":
                return chance.choice((None, 1, "text", [1, 2.5, {"a": True}]))
        raise AssertionError(node)

    def _count(self, least: int = 0, most: int | None = None) -> int:
        return self._chance.randint(least, min(least + 4, least + 4 if most is None else most))

    def _message(self, described: Mapping[str, Any]) -> Any:
        fields, tag = described["fields"], described.get("tag")
        if described.get("array"):
            return [*([] if tag is None else [tag]), *(self.value(field["type"]) for field in fields)]
        made = {} if tag is None else {described["tag_field"]: tag}
        for field in fields:
            can_be_absent = isinstance(field["type"], list) and "unset" in field["type"]
            if not can_be_absent or self._chance.random() < 0.5:
                made[field.get("key", field["name"])] = self.value(field["type"])
        return made
