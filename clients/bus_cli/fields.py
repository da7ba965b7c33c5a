"""Paths into messages, such as `pose.position.x` or `transforms[0].child_frame_id`."""

import re
from typing import Any

from bus_cli.output import CommandError

__all__ = ["FieldPath"]

_STEP = re.compile(r"\.?([^\W\d]\w*)|\[(-?\d+)\]")
_PYTHON_NAMES = {"string": "str", "float32": "float", "float64": "float", "bool": "bool", "none": "NoneType"}


class FieldPath:
    """A path typed by the user, for messages of `schema`.

    Raises CommandError with ros2's text if there is no such field.
    """

    def __init__(self, text: str, schema: dict[str, Any]) -> None:
        self.text = text
        self._steps = _parse(text)
        self.node: Any = schema["root"]
        """Type of the field in the schema."""
        try:
            for step in self._steps:
                self.node = _step(schema, self.node, step)
        except (AttributeError, IndexError, TypeError) as error:
            raise self._invalid(error) from None

    def pick(self, message: Any) -> Any:
        """The value of the field in `message`."""
        try:
            for step in self._steps:
                if isinstance(step, int) or isinstance(message, dict):
                    message = message[step]
                else:
                    message = getattr(message, step)
        except (AttributeError, LookupError, TypeError) as error:
            raise self._invalid(error) from None
        return message

    def _invalid(self, error: Exception) -> CommandError:
        return CommandError(f"Invalid field '{self.text}': {error}")


def _parse(text: str) -> list[str | int]:
    steps: list[str | int] = []
    end = 0
    while found := _STEP.match(text, end):
        steps.append(found[1] or int(found[2]))
        end = found.end()
    if not steps or end < len(text) or text.startswith("."):
        raise CommandError(f"Invalid field value '{text}'")
    return steps


def _step(schema: dict[str, Any], node: Any, step: str | int) -> Any:
    match node, step:
        case ["union", *members], _:
            known = [member for member in members if member not in ("none", "unset")]
            return _step(schema, known[0], step) if len(known) == 1 else "any"
        case "any", _:
            return "any"
        case ["dict", _, item], _:
            return item
        case ["list", item, *_], int():
            return item
        case ["tuple", *items], int():
            return items[step]
        case (("uint8[]" | ["bytes", *_]), int()):
            return "uint8"
        case "byte[]", int():
            return "byte"
        case str(), str() if "/" in node:
            for field in schema["types"][node]["fields"]:
                if field["name"] == step:
                    return field["type"]
    name = _python_name(node)
    if isinstance(step, int):
        raise TypeError(f"'{name}' object is not subscriptable")
    raise AttributeError(f"'{name}' object has no attribute '{step}'")


def _python_name(node: Any) -> str:
    if isinstance(node, list):
        return "str" if "string" in node[0] else str(node[0])
    if node.endswith("[]") or node == "byte":
        return "bytes"
    return _PYTHON_NAMES.get(node, "int") if "/" not in node else node.rpartition("/")[2]
