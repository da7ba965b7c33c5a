"""Errors for names that a module or a message class does not have: one line with the right way.

Only needed after mistakes: import it late.
"""

import sys
from collections.abc import Iterable, Iterator
from opcode import opmap
from types import FrameType, TracebackType
from typing import Any, Final

from bus.base.suggest import did_you_mean, nearest

__all__ = ["explain_unknown_field", "missing_name"]

_FROM_RCLPY: Final = {
    "init": "bus.run(main()) starts a program",
    "shutdown": "a program ends with its main()",
    "ok": "a program runs until its main() ends",
    "create_node": "write async with bus.Node(...) as node",
    "spin": "write await node.spin() in async def main()",
    "spin_once": "callbacks run while main() awaits, as in await node.spin()",
    "spin_until_future_complete": "write await future",
}
_UNKNOWN_FIELD: Final = "Unexpected keyword argument '"


def missing_name(module: str, name: str, names: Iterable[str], *, is_bus: bool = False) -> Exception:
    """The error for a module's `__getattr__`: `module` has no `name`, but `names`.

    It is an AttributeError. For `from module import name`, where Python would drop its text, it is an
    ImportError.
    """
    text = f"module '{module}' has no '{name}'"
    if is_bus and name in _FROM_RCLPY:
        text = f"{text}, which is rclpy's: {_FROM_RCLPY[name]}"
    else:
        text += did_you_mean(name, names)
    if _is_import(sys._getframe(2)):
        return ImportError(text, name=module)
    return AttributeError(text)  # without `name` and `obj`: Python would add a suggestion of its own


def explain_unknown_field(error: TypeError) -> None:
    """If a message was made with an unknown field, add a note with the fields of its class.

    msgspec's constructor names neither the class nor its fields, and an extra check would slow it down. So
    this searches the class among the names in the calling code.
    """
    text, trace = str(error), error.__traceback__
    if not text.startswith(_UNKNOWN_FIELD) or trace is None:
        return
    field = text.removeprefix(_UNKNOWN_FIELD).rstrip("'")
    found = {
        cls: nearest(field, fields) for cls, fields in _classes(_innermost(trace)) if field not in fields
    }
    likely = [cls for cls, near in found.items() if near] or list(found)
    if len(likely) == 1:
        (cls,) = likely
        hint = f"; did you mean '{found[cls]}'?" if found[cls] else ""
        fields = ", ".join(cls.__struct_fields__) or "none"
        error.add_note(f"fields of {cls.__name__}: {fields}{hint}")


def _is_import(frame: FrameType) -> bool:
    return frame.f_lasti >= 0 and frame.f_code.co_code[frame.f_lasti] == opmap["IMPORT_FROM"]


def _innermost(trace: TracebackType) -> FrameType:
    while trace.tb_next is not None:
        trace = trace.tb_next
    return trace.tb_frame


def _classes(frame: FrameType) -> Iterator[tuple[Any, tuple[str, ...]]]:
    """Message classes named in the code of `frame`, directly or as attributes of a module."""
    known = {**frame.f_globals, **frame.f_locals}
    values = [known[name] for name in (*frame.f_code.co_names, *frame.f_code.co_varnames) if name in known]
    values += [getattr(owner, name, None) for owner in tuple(values) for name in frame.f_code.co_names]
    for value in dict.fromkeys(one for one in values if isinstance(one, type)):
        fields = getattr(value, "__struct_fields__", None)
        if fields is not None:
            yield value, fields
