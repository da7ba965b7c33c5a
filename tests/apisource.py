"""Reads the public names of `bus` from its sources: signatures, types and docstrings.

Public are the names in `bus.__all__`, and the members of each class without an underscore. Members inherited
from another class of `bus` are included.
"""

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import bus

WIDTH = 100


@dataclass
class Entry:
    """One public name: `Node`, `Node.graph`, `Match.gid`."""

    path: str
    kind: str
    """class, enum, function, attribute, constant or module."""
    doc: str
    signature: str = ""
    """As in a program; for an attribute its type, for a member of an enum its value."""
    members: list["Entry"] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.path.rpartition(".")[2]


def entries() -> dict[str, Entry]:
    """Every public name of `bus`, including members, by path."""
    found: dict[str, Entry] = {}
    for name in bus.__all__:
        one = found[name] = _entry(name, getattr(bus, name))
        found.update({member.path: member for member in one.members})
    return found


def _entry(name: str, value: Any) -> Entry:
    if inspect.ismodule(value):
        return Entry(name, "module", _doc(_tree(value.__name__)).partition("\n\n")[0])
    if inspect.isclass(value):
        return _class(name, value)
    if inspect.isfunction(value):
        node = _find(_tree(value.__module__).body, value.__name__)
        assert isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        return Entry(name, "function", _doc(node), _call(node, f"bus.{name}"))
    return _constant(name)


def _doc(node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    """The docstring without the indentation of the code; `inspect.cleandoc` may remove more than that."""
    match node.body:
        case [ast.Expr(value=ast.Constant(value=str(text)), col_offset=indent), *_]:
            return "\n".join(line.removeprefix(" " * indent) for line in text.splitlines()).strip()
    return ""


def _constant(name: str) -> Entry:
    """The entry of a constant: found in the module from which `bus` imports it."""
    imports = [node for node in ast.walk(_tree("bus")) if isinstance(node, ast.ImportFrom)]
    (home, there), *_ = [
        (str(node.module), one.name)
        for node in imports
        for one in node.names
        if name == (one.asname or one.name)
    ]
    for found, _, value, doc in _assigned(_tree(home).body):
        if found == there:
            return Entry(name, "constant", doc, f"bus.{name} = {_source(value)}")
    raise LookupError(f"{home} has no {there}")


def _class(name: str, cls: type) -> Entry:
    one = Entry(name, "enum" if issubclass(cls, Enum) else "class", "")
    seen: set[str] = set()
    for part in cls.__mro__:
        if part.__module__.partition(".")[0] != "bus":
            continue
        node = _find(_tree(part.__module__).body, part.__name__)
        assert isinstance(node, ast.ClassDef), part
        if part is cls:
            one.doc = _doc(node)
        for member in _members(name, node):
            if member.name not in seen:
                seen.add(member.name)
                one.members.append(member)
        init = _find(_unfolded(node.body), "__init__")
        if part is cls and init is not None and _is_made_by_users(cls, one.doc):
            assert isinstance(init, ast.FunctionDef)
            one.signature = _call(init, f"bus.{name}", is_method=True).removesuffix(" -> None")
    if issubclass(cls, BaseException):
        one.signature = f"class bus.{name}({', '.join(base.__name__ for base in cls.__bases__)})"
    return one


def _is_made_by_users(cls: type, doc: str) -> bool:
    return not issubclass(cls, BaseException) and "made by `" not in doc.lower()


def _members(owner: str, node: ast.ClassDef) -> Iterator[Entry]:
    aliases = []
    for name, annotation, value, doc in _assigned(node.body):
        if isinstance(value, ast.Name) and not doc:
            aliases.append(Entry(f"{owner}.{name}", "function", f"The same as `{owner}.{value.id}`."))
        else:
            yield Entry(
                f"{owner}.{name}",
                "attribute",
                doc,
                _type(annotation) if annotation is not None else _source(value),
            )
    for one in node.body:
        if not isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        marks = {_source(mark).rpartition(".")[2] for mark in one.decorator_list}
        if one.name == "__init__" and isinstance(one, ast.FunctionDef):
            yield from _set_by(owner, one)
        elif one.name.startswith("_") or "overload" in marks:
            continue
        elif marks & {"property", "cached_property"}:
            yield Entry(f"{owner}.{one.name}", "attribute", _doc(one), _type(one.returns))
        else:
            signature = _call(one, one.name, is_method=True)
            yield Entry(f"{owner}.{one.name}", "function", _doc(one), signature)
    yield from aliases


def _set_by(owner: str, init: ast.FunctionDef) -> Iterator[Entry]:
    """The attributes that `__init__` sets; the type is the annotation, or the argument's."""
    given = {one.arg: one.annotation for one in [*init.args.args, *init.args.kwonlyargs]}
    for name, annotation, value, doc in _assigned(init.body, of_self=True):
        if annotation is None and isinstance(value, ast.Name):
            annotation = given.get(value.id)
        yield Entry(f"{owner}.{name}", "attribute", doc, _type(annotation))


def _assigned(
    body: list[ast.stmt], *, of_self: bool = False
) -> Iterator[tuple[str, ast.expr | None, ast.expr | None, str]]:
    """Public names that get a value or a type, as `name` or `self.name`, and the text below each."""
    target: ast.expr
    for one, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(one, ast.AnnAssign):
            target, annotation, value = one.target, one.annotation, one.value
        elif isinstance(one, ast.Assign) and len(one.targets) == 1:
            target, annotation, value = one.targets[0], None, one.value
        else:
            continue
        _, is_its_own, name = _source(target).rpartition("self.")
        if bool(is_its_own) is not of_self or not name.isidentifier():
            continue
        doc = ""
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            doc = inspect.cleandoc(str(following.value.value))
        if not name.startswith("_"):
            yield name, annotation, value, doc


def _unfolded(body: list[ast.stmt]) -> list[ast.stmt]:
    """The body, with statements that only type checkers see."""
    hidden = [one for outer in body if isinstance(outer, ast.If) for one in outer.body]
    return [*hidden, *body]


def _find(body: list[ast.stmt], name: str) -> ast.stmt | None:
    kinds = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    found = [one for one in body if isinstance(one, kinds) and one.name == name]
    return found[0] if found else None


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(Path(inspect.getfile(import_module(module))).read_text())


def _call(node: ast.FunctionDef | ast.AsyncFunctionDef, name: str, *, is_method: bool = False) -> str:
    """A signature, on one line or with a line for each argument."""
    given = node.args
    assert not given.posonlyargs, f"arguments by position alone are not shown yet: {name}"
    plain = given.args[1:] if is_method else given.args
    defaults: list[ast.expr | None] = [None] * (len(plain) - len(given.defaults)) + list(given.defaults)
    parts = [_argument(*one) for one in zip(plain, defaults, strict=True)]
    if given.vararg is not None:
        parts.append("*" + _argument(given.vararg, None))
    elif given.kwonlyargs:
        parts.append("*")
    parts += [_argument(*one) for one in zip(given.kwonlyargs, given.kw_defaults, strict=True)]
    if given.kwarg is not None:
        parts.append("**" + _argument(given.kwarg, None))
    head = "async " if isinstance(node, ast.AsyncFunctionDef) else ""
    back = f" -> {_type(node.returns)}" if node.returns is not None else ""
    line = f"{head}{name}({', '.join(parts)}){back}"
    if len(line) <= WIDTH:
        return line
    return "\n".join([f"{head}{name}(", *(f"    {part}," for part in parts), f"){back}"])


def _argument(argument: ast.arg, default: ast.expr | None) -> str:
    text = argument.arg
    if argument.annotation is not None:
        text += f": {_type(argument.annotation)}"
    if default is not None:
        text += f" = {_source(default)}" if argument.annotation is not None else f"={_source(default)}"
    return text


class _Unquote(ast.NodeTransformer):
    """Removes the quotes around forward references."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        return node if _source(node.value) == "Literal" else self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        is_type = isinstance(node.value, str) and re.fullmatch(r"[A-Z]\w*( \| \w+)*", node.value)
        return ast.parse(str(node.value), mode="eval").body if is_type else node


def _type(node: ast.expr | None) -> str:
    return _source(None if node is None else _Unquote().visit(node))


def _source(node: ast.AST | None) -> str:
    return "" if node is None else ast.unparse(node).replace("'", '"')
