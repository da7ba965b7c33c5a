"""`--filter EXPR`: a safe subset of Python's expressions, over `m`, the message.

ros2 passes the expression to eval(). This module compiles its syntax tree. It allows comparisons, arithmetic
on numbers, attributes that are fields, indexing, and/or/not, literals, and len, abs, min, max. It allows
nothing else. The length of the expression and the size of the message bound the cost of an evaluation.
"""

import ast
import operator
import warnings
from collections.abc import Callable
from typing import Any

from bus_cli.output import CommandError

__all__ = ["compile_filter"]

_MAX_LENGTH = 1000
_FUNCTIONS: dict[str, Callable[..., Any]] = {"len": len, "abs": abs, "min": min, "max": max}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda item, container: item in container,
    ast.NotIn: lambda item, container: item not in container,
}
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.Not: operator.not_,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_Evaluate = Callable[[Any], Any]


def compile_filter(text: str) -> Callable[[Any], bool]:
    """Make a function that returns whether a message passes.

    Raises CommandError for a wrong or forbidden expression. The function raises it if the expression does not
    fit a message.
    """
    if len(text) > _MAX_LENGTH:
        raise CommandError(f"--filter: the expression has {len(text)} characters, {_MAX_LENGTH} are allowed")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # for example, "2and" is valid but Python warns
            evaluate = _compile(ast.parse(text.strip(), mode="eval").body)
    except SyntaxError as error:
        raise CommandError(f"--filter: {error.msg}: {text}") from None
    except (ValueError, MemoryError, RecursionError) as error:
        raise CommandError(f"--filter: not understood ({type(error).__name__}): {text}") from None

    def passes(message: Any) -> bool:
        try:
            return bool(evaluate(message))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, RecursionError) as error:
            raise CommandError(f"--filter: {error} (in {text})") from None

    return passes


def _compile(node: ast.expr) -> _Evaluate:
    match node:
        case ast.Constant(value=value):
            return lambda m: value
        case ast.Name(id="m"):
            return lambda m: m
        case ast.Attribute(value=value, attr=name):
            return _compile_field(_compile(value), name)
        case ast.Subscript(value=value, slice=ast.Slice(lower=lower, upper=upper, step=None)):
            begin, end = (_compile(bound or ast.Constant(None)) for bound in (lower, upper))
            container = _compile(value)
            return lambda m: container(m)[begin(m) : end(m)]
        case ast.Subscript(value=value, slice=key):
            container, index = _compile(value), _compile(key)
            return lambda m: container(m)[index(m)]
        case ast.BoolOp(op=op, values=values):
            parts = [_compile(value) for value in values]
            if isinstance(op, ast.And):
                return lambda m: all(part(m) for part in parts)
            return lambda m: any(part(m) for part in parts)
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            unary, only = _UNARY[type(op)], _compile(operand)
            return lambda m: unary(only(m))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
            return _compile_arithmetic(_ARITHMETIC[type(op)], _compile(left), _compile(right))
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            compares = [_COMPARISONS[type(op)] for op in ops]
            return _compile_comparison([_compile(part) for part in (left, *comparators)], compares)
        case ast.Tuple(elts=items) | ast.List(elts=items):
            parts = [_compile(item) for item in items]
            return lambda m: [part(m) for part in parts]
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
            function, parts = _FUNCTIONS[name], [_compile(arg) for arg in args]
            return lambda m: function(*(part(m) for part in parts))
    raise CommandError(
        f"--filter: not allowed: {ast.unparse(node)} (allowed are m.field, indexing, comparisons, "
        "arithmetic, and/or/not, literals, len, abs, min, max)"
    )


def _compile_field(value: _Evaluate, name: str) -> _Evaluate:
    def field(m: Any) -> Any:
        owner = value(m)
        # Allow only fields: methods and dunders reach beyond the message.
        if name not in getattr(type(owner), "__struct_fields__", ()):
            raise AttributeError(f"'{type(owner).__name__}' object has no attribute '{name}'")
        return getattr(owner, name)

    return field


def _compile_arithmetic(operate: Callable[[Any, Any], Any], left: _Evaluate, right: _Evaluate) -> _Evaluate:
    def arithmetic(m: Any) -> Any:
        operands = left(m), right(m)
        # Allow only numbers: 'x' * 10**9 would use up the memory.
        if not all(isinstance(operand, int | float) for operand in operands):
            kinds = " and ".join(type(operand).__name__ for operand in operands)
            raise TypeError(f"arithmetic is for numbers, not {kinds}")
        return operate(*operands)

    return arithmetic


def _compile_comparison(parts: list[_Evaluate], compares: list[Callable[[Any, Any], Any]]) -> _Evaluate:
    def comparison(m: Any) -> Any:
        left = parts[0](m)
        for compare, part in zip(compares, parts[1:], strict=True):
            right = part(m)
            if not compare(left, right):
                return False
            left = right
        return True

    return comparison
