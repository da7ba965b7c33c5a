"""The surface of rclpy: every public name of its modules and classes, with the arguments of each call.

surface.names lists the names; `python surface.py names` prints it under rclpy. Other programs check
attributes that only instances have.
"""

import importlib
import inspect
import pkgutil
import sys
from enum import Enum
from pathlib import Path

PLAIN = (int.__repr__, str.__repr__, float.__repr__, bool.__repr__)
NAMES = Path(__file__).with_suffix(".names")


def modules():
    import rclpy

    yield "rclpy"
    for found in pkgutil.walk_packages(rclpy.__path__, "rclpy."):
        if not found.name.rpartition(".")[2].startswith("_"):
            yield found.name


def names():
    """Each public name that a module defines, and each member that such a class defines."""
    for module in modules():
        loaded = importlib.import_module(module)
        yield module
        for name, value in sorted(vars(loaded).items()):
            if name.startswith("_") or name == "TYPE_CHECKING" or inspect.ismodule(value):
                continue
            home = getattr(value, "__module__", module)
            if home not in (module, "rclpy._rclpy_pybind11") or type(value).__module__ == "typing":
                continue
            yield f"{module}.{name}"
            if isinstance(value, type) and not issubclass(value, BaseException):
                yield from (f"{module}.{name}.{member}" for member in members(value))


def members(cls):
    plain = {*dir(Enum), "name", "value"} if is_enum(cls) else dir(object)
    return [name for name in dir(cls) if not name.startswith("_") and name not in plain]


def is_enum(cls):
    return hasattr(cls, "__members__")


def find(path):
    """The object at a path; raises ImportError or AttributeError."""
    parts = path.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for name in parts[count:]:
            found = inspect.getattr_static(found, name) if isinstance(found, type) else getattr(found, name)
        return found
    raise ImportError(path)


def shown(value):
    if isinstance(value, (staticmethod, classmethod)):
        value = value.__func__
    if inspect.ismodule(value):
        return ": a module"
    if isinstance(value, type):
        if is_enum(value):
            return ": an enum"
    elif is_enum(type(value)):
        return f" = {int(value)}" if hasattr(value, "__int__") else ""
    if isinstance(value, (int, str, float)) and type(value).__repr__ in PLAIN:
        return f" = {value!r}"
    if not callable(value) or getattr(value, "__module__", "").endswith("_rclpy_pybind11"):
        return ""
    try:
        taken = inspect.signature(value)
    except (TypeError, ValueError):
        return ""
    return f"({', '.join(arguments(taken))})"


def arguments(taken):
    is_named = False
    for parameter in taken.parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY and not is_named:
            is_named = True
            yield "*"
        if parameter.kind is parameter.VAR_POSITIONAL:
            is_named = True
            yield "*..."
        elif parameter.kind is parameter.VAR_KEYWORD:
            yield "**..."
        elif parameter.name != "self":
            yield parameter.name + ("" if parameter.default is parameter.empty else "=")


def main():
    if sys.argv[1:] == ["names"]:
        print(*names(), sep="\n")
        return
    for path in NAMES.read_text().splitlines():
        try:
            print(f"{path}{shown(find(path))}")
        except (ImportError, AttributeError):
            print(f"{path} is missing")


main()
